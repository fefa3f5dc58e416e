"""Training: settings, averages without bias, and runs that are killed and extended."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file
from small_training import dataset, number, run, shorter, train_number

from deggflow.jsonl import InputError
from deggflow.train import TrainingConfig, read_curves, run_segments, train

PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, {root!r})
from {module} import run
run(Path(sys.argv[1]), lambda curve: print(curve.step, flush=True))
"""


def its_weight(field, tau, x0, x1, condition, mask):
    """A loss of gradient one that tells the weight itself."""
    return field.weight


class KilledError(Exception):
    pass


def killed_at(step):
    """Stops a run at a point of its curves, whose checkpoint is written."""

    def on_progress(curve):
        if curve.step == step:
            raise KilledError

    return on_progress


@pytest.mark.parametrize("step", [{"steps": 1234}, {"steps": 0}, {"steps": -500}])
def test_config_refuses_steps_without_a_checkpoint_at_the_end(step):
    with pytest.raises(ValueError, match="`steps` must be a positive multiple"):
        TrainingConfig(**step)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("validate_every", 0),
        ("batch", 0),
        ("warmup", -1),
        ("seed", -1),
        ("seed", 2**31),
        ("learning_rate", 0.0),
        ("learning_rate", float("nan")),
        ("weight_decay", -1.0),
        ("average", 1.0),
        ("average", -0.1),
    ],
)
def test_config_names_the_setting_that_is_out_of_range(name, value):
    with pytest.raises(ValueError, match=rf"`{name}` must .*; got {value}\."):
        TrainingConfig(**{name: value})


@pytest.mark.parametrize("decay", [0.0, 0.999])
def test_averaged_weights_hold_no_share_of_the_initial_ones(tmp_path, decay):
    """The curves of this loss are the weight before a step and the average after it; its mean is taken in float64."""
    steps = 30
    config = shorter(steps, learning_rate=0.5, average=decay, validate_every=1)
    field, curves = train_number(tmp_path, config=config, field=number(20.0), loss=its_weight)
    before = np.array([curve.training for curve in curves])
    assert before[0] == 20.0
    for done in range(1, steps):
        after = before[1 : done + 1].astype(np.float64)
        share = decay ** np.arange(done - 1, -1, -1, dtype=np.float64)
        expected = np.sum(share * after) / np.sum(share)
        assert curves[done - 1].validation == pytest.approx(expected, rel=2e-6)
    assert np.ptp(before) > 5  # the weights do move, and their mean is not any one of them
    assert float(field.weight) == curves[-1].validation


def test_the_average_goes_on_through_an_extension(tmp_path):
    config = shorter(10, learning_rate=0.5, average=0.8, validate_every=1)
    train_number(tmp_path, config=config, loss=its_weight)
    _, curves = train_number(tmp_path, config=replace(config, steps=20), loss=its_weight)
    after = np.array([curve.training for curve in curves], np.float64)[1:]
    share = 0.8 ** np.arange(18, -1, -1)
    assert curves[18].validation == pytest.approx(np.sum(share * after) / np.sum(share), rel=1e-6)


def test_steps_that_are_added_have_a_warm_up_and_a_cosine_of_their_own(tmp_path):
    """Of a constant gradient Adam makes steps of the learning rate."""
    config = shorter(40, learning_rate=0.5, validate_every=1, weight_decay=0.0)
    train_number(tmp_path, config=config, loss=its_weight)
    _, curves = train_number(tmp_path, config=replace(config, steps=100), loss=its_weight)
    rates = -np.diff([curve.training for curve in curves])

    def rate(step, steps):
        warmup = min(5, steps // 10)
        if step < warmup:
            return 0.5 * step / warmup
        return 0.25 * (1 + np.cos(np.pi * (step - warmup) / (steps - warmup)))

    expected = [*(rate(k, 40) for k in range(40)), *(rate(k, 60) for k in range(59))]
    np.testing.assert_allclose(rates, expected, atol=1e-5)


def test_an_extension_is_the_same_killed_or_not(tmp_path):
    """Killed before its first checkpoint, and between two; to the bit."""
    weights = []
    for kills in ((), (40, 60)):
        folder = tmp_path / str(kills)
        first, _ = train_number(folder)
        for step in kills:
            with pytest.raises(KilledError):
                train_number(folder, 80, on_progress=killed_at(step))
        field, curves = train_number(folder, 80)
        assert [curve.step for curve in curves] == list(range(10, 81, 10))
        assert run_segments(folder) == [40, 80]
        assert float(first.weight) != float(field.weight)
        weights.append(float(field.weight))
        again, same = train_number(folder, 80)
        assert (float(again.weight), same) == (weights[-1], curves)
    assert weights[0] == weights[1]
    one, other = ((tmp_path / str(kills)) for kills in ((), (40, 60)))
    for name in ("config.json", "curves.csv"):
        assert (one / name).read_text() == (other / name).read_text()


def test_a_run_is_extended_again_and_what_it_returned_may_be_given(tmp_path):
    initial = number()
    field, _ = train_number(tmp_path, 10, field=initial)
    field, _ = train_number(tmp_path, 20, field=field)
    _, curves = train_number(str(tmp_path), 50, field=initial)
    assert len(curves) == 5
    assert float(initial.weight) == 5.0  # left as it was
    assert run_segments(str(tmp_path)) == [10, 20, 50]


def test_other_steps_are_refused_unless_they_extend_a_finished_run(tmp_path):
    with pytest.raises(KilledError):
        train_number(tmp_path, on_progress=killed_at(20))
    for steps in (10, 30, 80):
        with pytest.raises(InputError, match=f"`steps` is {steps} here, 40 in .* 20 are done"):
            train_number(tmp_path, steps)
    train_number(tmp_path)
    with pytest.raises(InputError, match="`steps` is 30 here, but 40 are done in this folder"):
        train_number(tmp_path, 30)
    with pytest.raises(KilledError):  # an extension is not finished either
        train_number(tmp_path, 80, on_progress=killed_at(60))
    for steps in (40, 120):
        with pytest.raises(InputError, match=f"`steps` is {steps} here, 80 in .* 60 are done"):
            train_number(tmp_path, steps)
    assert run_segments(tmp_path) == [40, 80]


def test_data_whose_parts_differ_in_length_are_refused_by_name(tmp_path):
    data, config = dataset(0, 8), shorter(10)
    with pytest.raises(ValueError, match=r"`training.condition` must have 8 samples .* \(7,\)"):
        train(number(), data._replace(condition=data.condition[:7]), data, config, tmp_path)
    with pytest.raises(ValueError, match="`validation` must hold at least one sample"):
        train(number(), data, dataset(0, 0), config, tmp_path)


def test_identities_are_what_json_has(tmp_path):
    with pytest.raises(ValueError, match="`identity` must hold values that JSON can represent"):
        train_number(tmp_path, 10, identity={"width": object()})


def test_the_loss_falls(tmp_path):
    curves = run(tmp_path)
    assert [curve.step for curve in curves] == list(range(20, 401, 20))
    assert curves[-1].validation < 0.6 * curves[0].validation
    assert read_curves(tmp_path / "curves.csv") == curves
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["settings"]["batch"] == 16
    assert config["functions"] == {"loss": "deggflow.flow.mac_loss", "augment": "None"}


@pytest.mark.slow
def test_killed_training_resumes_to_the_same_weights(tmp_path):
    """SIGKILL three times at random moments, then to the end."""
    program = PROGRAM.format(root=str(Path(__file__).parent / "helpers"), module=run.__module__)
    rng = np.random.default_rng(0)

    def start(folder):
        return subprocess.Popen(
            [sys.executable, "-c", program, str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    whole = start(tmp_path / "whole")
    assert whole.communicate()[0].split()[-1] == "400"
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
    last.communicate()
    assert last.returncode == 0
    one, other = (load_file(tmp_path / name / "end.safetensors") for name in ("whole", "killed"))
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name])
    assert (tmp_path / "whole/curves.csv").read_text() == (folder / "curves.csv").read_text()
