"""Training: the loss falls, and a killed run ends in the same weights as an uninterrupted one."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from deggflow.jsonl import InputError
from deggflow.train import Dataset, TrainingConfig, read_curves, train

PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_train import run
run(Path(sys.argv[1]), lambda curve: print(curve.step, flush=True))
"""
CONFIG = TrainingConfig(steps=400, batch=16, warmup=20, validate_every=20, average=0.9, seed=3)


class Shift(eqx.Module):
    """A small field for a small problem."""

    network: eqx.nn.MLP

    def __call__(self, tau, z, condition):
        return jax.vmap(lambda row: self.network(jax.numpy.append(row, tau)))(z)


def dataset(seed, samples):
    rng = np.random.default_rng(seed)
    z = (np.array([1.0, -1.0]) + 0.1 * rng.normal(size=(samples, 3, 2))).astype(np.float32)
    return Dataset(z, np.zeros(samples, np.float32), np.ones((samples, 3), bool))


def run(folder, on_progress=lambda curve: None):
    from deggflow.weights import save_weights

    field = Shift(eqx.nn.MLP(3, 2, 32, depth=2, key=jax.random.key(0)))
    trained, curves = train(
        field, dataset(0, 200), dataset(1, 50), CONFIG, folder, on_progress=on_progress
    )
    save_weights(folder / "end.safetensors", trained, {})
    return curves


def test_config_refuses_steps_without_a_checkpoint_at_the_end():
    with pytest.raises(ValueError, match="`steps` must be a positive multiple"):
        TrainingConfig(steps=1234)


def test_the_loss_falls_and_a_folder_holds_one_run(tmp_path):
    curves = run(tmp_path)
    assert [curve.step for curve in curves] == list(range(20, 401, 20))
    assert curves[-1].validation < 0.6 * curves[0].validation
    assert read_curves(tmp_path / "curves.csv") == curves
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["batch"] == 16
    field = Shift(eqx.nn.MLP(3, 2, 32, depth=2, key=jax.random.key(0)))
    other = TrainingConfig(steps=400, batch=8, warmup=20, validate_every=20, average=0.9, seed=3)
    with pytest.raises(InputError, match="`batch` = 16 was begun here, now `batch` = 8"):
        train(field, dataset(0, 200), dataset(1, 50), other, tmp_path)


@pytest.mark.slow
def test_killed_training_resumes_to_the_same_weights(tmp_path):
    """SIGKILL three times at random moments, then to the end."""
    program = PROGRAM.format(tests=str(Path(__file__).parent))
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "cache")}
    rng = np.random.default_rng(0)

    def start(folder):
        return subprocess.Popen(
            [sys.executable, "-c", program, str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )

    whole = start(tmp_path / "whole")
    assert whole.communicate(timeout=240)[0].split()[-1] == "400"
    folder, reached = tmp_path / "killed", 0
    for _ in range(3):
        process = start(folder)
        step = int(process.stdout.readline())
        assert step >= reached  # what was checkpointed is not trained again
        for _ in range(int(rng.integers(1, 4))):
            step = int(process.stdout.readline())
        time.sleep(rng.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        reached = step
    last = start(folder)
    last.communicate(timeout=240)
    assert last.returncode == 0
    one, other = (load_file(tmp_path / name / "end.safetensors") for name in ("whole", "killed"))
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name])
    assert (tmp_path / "whole/curves.csv").read_text() == (folder / "curves.csv").read_text()
