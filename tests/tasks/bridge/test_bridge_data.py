"""Demonstration files: written so that a kill loses nothing, read back, encoded so that they decode again."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.jsonl import InputError
from deggflow.task import write_data
from deggflow.tasks.bridge.codec import decode_twists, spline_matrix
from deggflow.tasks.bridge.data import approaches, load_dataset, read_demonstrations
from deggflow.tasks.bridge.expert import random_demonstration
from deggflow.tasks.bridge.model import BridgeModel
from deggflow.tasks.bridge.options import DemonstrationRecipe

MODEL = BridgeModel()
SIZES, TRAINING, VALIDATION = (4, 6), 4, 2
RECIPE = DemonstrationRecipe(sizes=SIZES, training=TRAINING, validation=VALIDATION, seed=3)
TRAINING_FILE = "training.jsonl"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("data")
    write_data(MODEL, path, RECIPE)
    return path


@pytest.fixture(scope="module")
def loaded(folder):
    """Encoded without disturbance: dataset and scales."""
    return load_dataset(folder / TRAINING_FILE, None, perturb=False)


def test_as_many_demonstrations_of_each_size_as_asked_for(folder):
    for name, count in (("training", TRAINING), ("validation", VALIDATION)):
        made = read_demonstrations(folder / f"{name}.jsonl")
        assert [len(d.condition.contacts) for d in made] == [s for s in SIZES for _ in range(count)]
        assert [d.number for d in made] == [*range(count)] * len(SIZES)


def test_what_is_read_is_what_was_made(folder):
    for one in read_demonstrations(folder / TRAINING_FILE)[::3]:
        made = random_demonstration(len(one.condition.contacts), one.seed, one.number)
        assert (one.condition, one.approach, one.bridged) == (
            made.condition,
            made.approach,
            made.bridged,
        )
        np.testing.assert_array_equal(one.twists, made.twists)


def test_training_and_validation_differ(folder):
    starts = [
        one.condition.plank
        for name in ("training", "validation")
        for one in read_demonstrations(folder / f"{name}.jsonl")
    ]
    assert len(set(starts)) == len(starts) == len(SIZES) * (TRAINING + VALIDATION)


@pytest.mark.parametrize("finished", [0, 3, 7])
def test_a_killed_file_is_completed_to_the_same_bytes(folder, tmp_path, finished):
    """Cut in the middle of the line after the finished ones."""
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    whole = (folder / TRAINING_FILE).read_bytes()
    lines = whole.splitlines(keepends=True)
    (tmp_path / TRAINING_FILE).write_bytes(b"".join(lines[:finished]) + lines[finished][:100])
    write_data(MODEL, tmp_path, RECIPE)
    assert (tmp_path / TRAINING_FILE).read_bytes() == whole


def test_a_finished_folder_is_left_as_it_is(folder):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    told = []
    write_data(MODEL, folder, RECIPE, lambda done, total: told.append((done, total)))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert told[-1] == (12, 12)


def test_another_recipe_is_not_mixed_in(folder):
    before = (folder / TRAINING_FILE).read_bytes()
    with pytest.raises(InputError, match="seed"):
        write_data(MODEL, folder, replace(RECIPE, seed=4))
    assert (folder / TRAINING_FILE).read_bytes() == before


WRONG = {
    "twists": lambda d: d["twists"].__setitem__(3, [0.1, 0.2]),
    "twists[2][1]": lambda d: d["twists"][2].__setitem__(1, "fast"),
    "approach": lambda d: d["approach"].__setitem__("side", "up"),
    "approach.pace": lambda d: d["approach"].__setitem__("pace", 3.0),
    "approach.turn": lambda d: d["approach"].pop("turn"),
    "bridged": lambda d: d.__setitem__("bridged", len(d["twists"]) + 1),
    "number": lambda d: d.__setitem__("number", True),
    "seed": lambda d: d.__setitem__("seed", -1),
    "condition.plank.x": lambda d: d["condition"]["plank"].__setitem__("x", 70.0),
    "surprise": lambda d: d.__setitem__("surprise", 1),
}


@pytest.mark.parametrize("field", WRONG)
def test_a_bad_line_is_refused_with_its_place(folder, tmp_path, field):
    lines = (folder / TRAINING_FILE).read_text().splitlines()
    value = json.loads(lines[1])
    WRONG[field](value)
    path = tmp_path / TRAINING_FILE
    path.write_text("\n".join([lines[0], json.dumps(value), *lines[2:]]) + "\n")
    with pytest.raises(InputError) as caught:
        load_dataset(path, None, perturb=False)
    assert (caught.value.file, caught.value.line) == (path, 2)
    assert caught.value.field.startswith(field.split("[")[0])


def test_no_demonstrations_are_refused(tmp_path):
    (tmp_path / TRAINING_FILE).write_text("")
    with pytest.raises(InputError, match="empty"):
        load_dataset(tmp_path / TRAINING_FILE, None, perturb=False)


def test_scales_are_positive_and_finite(loaded):
    _, scales = loaded
    assert [len(leaf) for leaf in scales] == [24, 40, 40, 2, 3]
    for name in ("eta", "continuation_std", "contact", "twist"):
        assert min(getattr(scales, name)) > 0
    assert np.isfinite(np.concatenate(scales)).all()


def test_given_scales_are_kept(folder, loaded):
    """Validation data are encoded with the scales of the training set."""
    dataset, scales = loaded
    given = scales._replace(eta=tuple(2 * v for v in scales.eta))
    again, kept = load_dataset(folder / TRAINING_FILE, given, perturb=False)
    assert kept == given
    np.testing.assert_allclose(2 * again.z, dataset.z, rtol=1e-6)


def test_scales_of_loss_are_standard_deviations_over_the_training_set(folder, loaded):
    """sigma_xi over every window's twists, sigma_c over every robot's contact velocities."""
    dataset, scales = loaded
    twists, velocities, seen = [], [], set()
    contacts, mask = (
        np.asarray(dataset.condition.condition.contacts, np.float64),
        np.asarray(dataset.mask),
    )
    for k, window in enumerate(np.asarray(dataset.condition.twists, np.float64)):
        if window.tobytes() in seen:
            continue
        seen.add(window.tobytes())
        twists.append(window)
        for r in contacts[k][mask[k]]:
            velocities.append(window @ np.array([[1, 0, -r[1]], [0, 1, r[0]]]).T)
    np.testing.assert_allclose(scales.twist, np.std(np.concatenate(twists), axis=0), rtol=1e-3)
    np.testing.assert_allclose(
        scales.contact, np.std(np.concatenate(velocities), axis=0), rtol=1e-3
    )


def test_windows_are_those_of_the_demonstrations(folder, loaded):
    """Every replanning until the gap is bridged occurs, with the plank where it then is."""
    dataset, _ = loaded
    state = dataset.condition.condition
    found = {
        (window.tobytes(), pose.tobytes())
        for window, pose in zip(
            np.asarray(dataset.condition.twists), np.asarray(state.plank), strict=True
        )
    }
    expected = set()
    for one in read_demonstrations(folder / TRAINING_FILE):
        twists = np.concatenate([one.twists, np.zeros((40, 3))])
        place, theta, poses = complex(*one.condition.plank[:2]), one.condition.plank[2], []
        for v1, v2, omega in one.twists:
            poses.append((place.real, place.imag, theta))
            angle = 0.2 * omega
            chord = np.expm1(1j * angle) / (1j * angle) if angle else 1.0
            place, theta = place + np.exp(1j * theta) * chord * complex(v1, v2) * 0.2, theta + angle
        for start in range(0, one.bridged, 4):
            expected.add((twists[start : start + 20].astype(np.float32).tobytes(), poses[start]))
    assert {window for window, _ in found} == {window for window, _ in expected}
    poses = np.array(sorted(pose for _, pose in expected))
    there = np.array(sorted(np.frombuffer(pose, np.float32).tolist() for _, pose in found))
    np.testing.assert_allclose(there, poses, atol=1e-5)


def test_continuations_are_what_the_plan_before_has_left(folder, loaded):
    """At rest at the start; later it agrees with the target up to the last four values and the blend."""
    state, target = loaded[0].condition
    ahead, target, motion = (np.asarray(x) for x in (state.continuation, target, state.twist))
    first = np.all(ahead == 0, axis=(1, 2))
    assert first.sum() >= len(SIZES) * TRAINING
    assert not np.any(motion[first])
    np.testing.assert_allclose(ahead[~first, 5:16], target[~first, 5:16], atol=1e-6)
    np.testing.assert_allclose(
        ahead[~first, 16:], np.repeat(target[~first, 15:16], 4, axis=1), atol=1e-6
    )
    between = (ahead[~first, :5] - motion[~first, None]) * (target[~first, :5] - ahead[~first, :5])
    assert between.min() >= -1e-6


def test_states_decode_to_the_experts_twists_within_the_splines_error(loaded):
    """z decodes to the least-squares fit of the expert's plan: no other combination of splines is nearer."""
    dataset, scales = loaded
    decoded = jax.jit(jax.vmap(lambda z, c: decode_twists(z, c, scales)))
    twists = np.asarray(decoded(dataset.z, dataset.condition.condition))
    target = np.asarray(dataset.condition.twists)
    ahead = np.asarray(dataset.condition.condition.continuation)
    basis = np.asarray(spline_matrix())
    project = basis @ np.linalg.solve(basis.T @ basis, basis.T)
    expected = ahead + np.einsum("st,ntd->nsd", project, target - ahead)
    np.testing.assert_allclose(twists, expected, atol=2e-5)
    assert np.abs(twists - target).max() < 0.15
    assert np.sqrt(np.mean((twists - target) ** 2)) < 0.02
    assert np.isfinite(np.asarray(dataset.z)).all()
    assert np.all(np.asarray(dataset.z) == np.asarray(dataset.z)[:, :1])


def test_disturbed_continuations_leave_the_target_as_it_is(folder, loaded):
    """Only what is told of the past changes; starts from rest stay at rest; the same in every call."""
    clean, scales = loaded
    perturbed, again = (
        load_dataset(folder / TRAINING_FILE, scales, perturb=True)[0] for _ in range(2)
    )
    for a, b in zip(jax.tree.leaves(perturbed), jax.tree.leaves(again), strict=True):
        assert jnp.array_equal(a, b)
    np.testing.assert_array_equal(perturbed.condition.twists, clean.condition.twists)
    np.testing.assert_array_equal(
        perturbed.condition.condition.plank, clean.condition.condition.plank
    )
    before, after = (np.asarray(d.condition.condition.continuation) for d in (clean, perturbed))
    first = np.all(before == 0, axis=(1, 2))
    np.testing.assert_array_equal(after[first], before[first])
    changed = np.any(after != before, axis=(1, 2))[~first]
    assert 0.2 < changed.mean() < 0.8
    decoded = jax.jit(jax.vmap(lambda z, c: decode_twists(z, c, scales)))
    twists = np.asarray(decoded(perturbed.z, perturbed.condition.condition))
    assert np.abs(twists - np.asarray(perturbed.condition.twists)).max() < 0.4


def test_shares_of_the_ways_to_approach_are_counts_of_the_file(folder):
    rates = approaches(folder / TRAINING_FILE)
    assert set(rates) == {"left, early", "left, late", "right, early", "right, late"}
    assert sum(rate.successes for rate in rates.values()) == TRAINING * len(SIZES)
    lines = (folder / TRAINING_FILE).read_text().splitlines()
    kept = [json.loads(line)["approach"] for line in lines]
    late_left = sum(one["side"] == "left" and one["turn"] == "late" for one in kept)
    assert rates["left, late"] == (late_left, TRAINING * len(SIZES))
