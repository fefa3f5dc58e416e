"""The training loss against a second implementation, and a tiny training run."""

import json
import shutil
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.app.remake import remake
from deggflow.jsonl import InputError
from deggflow.task import train_field, write_data
from deggflow.tasks.bridge.codec import spline_matrix
from deggflow.tasks.bridge.condition import Scales, to_arrays
from deggflow.tasks.bridge.data import Example
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.model import BridgeModel, training_loss
from deggflow.tasks.bridge.options import DemonstrationRecipe
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.train import TrainingConfig, read_curves

MODEL, COMMANDS = BridgeModel(), remake("bridge", DemonstrationRecipe, {})
AGENTS, DIM, T, K = 6, 24, 20, 8
rng = np.random.default_rng(0)
SCALES = Scales(
    eta=tuple(rng.uniform(0.1, 1.0, DIM).tolist()), contact=(0.2, 0.3), twist=(0.25, 0.15, 0.1)
)


def wavy(tau, z, condition):
    """A field to be scored; what it is does not matter."""
    return jnp.sin(3.0 * z + tau) + 0.1 * condition.plank[0]


def jacobian(r):
    return np.array([[1.0, 0.0, -r[1]], [0.0, 1.0, r[0]]])


def by_hand(tau, x0, x1, contacts, ahead, target, plank_x):
    """L_MAC + 0.16 L_motion + 0.45 L_twist of the robots that are there (paper, App. on Task 1)."""
    robots = len(contacts)
    x = (1 - tau) * x0 + tau * x1
    found = np.sin(3 * x + tau) + 0.1 * plank_x
    mac = sum(np.sum((found[i] - (x1[i] - x0[i])) ** 2) for i in range(robots)) / robots
    end = (x + (1 - tau) * found) * SCALES.eta
    g = sum(jacobian(r).T @ jacobian(r) for r in contacts)
    team = np.zeros((K, 3))
    for r, z in zip(contacts, end, strict=True):
        team += np.linalg.solve(g, jacobian(r).T @ jacobian(r) @ z.reshape(K, 3).T).T
    twists = ahead + spline_matrix() @ team
    rho = np.array([2.5] * 4 + [1.0] * 16)
    twist = motion = 0.0
    for t in range(T):
        error = twists[t] - target[t]
        twist += rho[t] * np.sum((error / SCALES.twist) ** 2)
        for r in contacts:
            motion += rho[t] * np.sum((jacobian(r) @ error / SCALES.contact) ** 2)
    return mac + 0.16 * motion / (2 * robots * rho.sum()) + 0.45 * twist / (3 * rho.sum())


scored = jax.jit(lambda *a: training_loss(SCALES)(wavy, *a))


@pytest.mark.parametrize("robots", [2, 4, 6])
@pytest.mark.parametrize("tau", [0.0, 0.4, 1.0])
def test_loss_is_the_papers(robots, tau):
    """Whatever stands in the padding."""
    rng = np.random.default_rng(robots)
    x0, x1 = rng.normal(size=(2, AGENTS, DIM))
    ahead, target = 0.3 * rng.normal(size=(2, T, 3))
    trial = random_conditions(robots, 1, 5)[0]
    state = jax.tree.map(lambda leaf: leaf[0], to_arrays([trial], AGENTS))
    contacts = np.asarray(state.contacts).copy()
    contacts[robots:] = rng.normal(size=(AGENTS - robots, 2))
    state = state._replace(
        contacts=jnp.asarray(contacts), continuation=jnp.asarray(ahead, jnp.float32)
    )
    found = scored(
        jnp.asarray(tau),
        jnp.asarray(x0, jnp.float32),
        jnp.asarray(x1, jnp.float32),
        Example(state, jnp.asarray(target, jnp.float32)),
        state.mask,
    )
    expected = by_hand(
        tau, x0[:robots], x1[:robots], np.array(trial.contacts), ahead, target, trial.plank[0]
    )
    assert float(found) == pytest.approx(expected, rel=1e-4)


CONFIG = TrainingConfig(
    steps=40, batch=8, learning_rate=3e-3, warmup=5, average=0.8, validate_every=20, seed=1
)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("bridge") / "data"
    write_data(MODEL, path, DemonstrationRecipe(sizes=(4,), training=4, validation=2, seed=1))
    return path


@pytest.fixture(scope="module")
def run(data, tmp_path_factory):
    """A tiny training run: the folder and the field."""
    out = tmp_path_factory.mktemp("bridge") / "run"
    return out, train_field(MODEL, data, out, CONFIG, commands=COMMANDS)


def test_training_lowers_the_loss(run):
    curves = read_curves(run[0] / "curves.csv")
    assert [c.step for c in curves] == [20, 40]
    assert curves[-1].training < 0.8 * curves[0].training
    assert curves[-1].validation < curves[0].validation


def test_the_weights_come_with_a_card_that_says_how(run, data):
    out, trained = run
    card = json.loads((out / "field.json").read_text())
    assert card["task"] == "bridge"
    assert card["training"]["steps"] == 40
    assert card["data"]["sizes"] == [4]
    assert "--seed 1" in card["commands"][0]
    field = load_field(out / "field.safetensors")
    for a, b in zip(jax.tree.leaves(field), jax.tree.leaves(trained), strict=True):
        np.testing.assert_array_equal(a, b)
    assert field.scales == trained.scales


def test_a_finished_run_is_not_trained_again(run, data):
    """Read from its last checkpoint: the same weights, to the bit."""
    out, _ = run
    before = (out / "field.safetensors").read_bytes()
    train_field(MODEL, data, out, CONFIG, commands=COMMANDS)
    assert (out / "field.safetensors").read_bytes() == before


def test_a_finished_run_is_extended_and_its_card_says_so(run, data, tmp_path):
    out = shutil.copytree(run[0], tmp_path / "run")
    train_field(MODEL, str(data), str(out), replace(CONFIG, steps=60), commands=COMMANDS)
    card = json.loads((out / "field.json").read_text())
    assert card["training"]["steps"] == 60
    assert card["training"]["segments"] == [40, 60]
    first, second = card["commands"][1:]
    assert "--steps 40 " in first
    assert second == first.replace("--steps 40 ", "--steps 60 ")
    assert [c.step for c in read_curves(out / "curves.csv")] == [20, 40, 60]
    assert "segments" not in json.loads((run[0] / "field.json").read_text())["training"]
    load_field(str(out / "field.safetensors"))


def test_other_data_are_not_mixed_in(run, data, tmp_path):
    """The last of four demonstrations left out: the first array that differs is named."""
    other = shutil.copytree(data, tmp_path / "data")
    lines = (other / "training.jsonl").read_text().splitlines(keepends=True)
    (other / "training.jsonl").write_text("".join(lines[:-1]))
    with pytest.raises(InputError, match=r"`training\.z` is float32 \(\d+, 6, 24\) here, float32"):
        train_field(MODEL, other, run[0], CONFIG)


def test_other_settings_are_not_mixed_in(run, data):
    with pytest.raises(InputError, match="batch"):
        train_field(MODEL, data, run[0], TrainingConfig(**{**CONFIG.__dict__, "batch": 9}))
