"""The tabletop's metrics by hand and by complex numbers, and its figures in order."""

import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.deviation import decoder_lipschitz
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.codec import decode, decode_exactly
from deggflow.tasks.tabletop.condition import SceneCondition, take, to_arrays
from deggflow.tasks.tabletop.deviation import deviation, deviation_of_scenes, scene_distances
from deggflow.tasks.tabletop.generator import TabletopGenerator

CASES, PATHS, SIZE = 9, 4, 4


def random_poses(seed, scenes):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(scenes, SIZE, 3)) * np.array([0.4, 0.3, 3.0])


def test_scenes_are_compared_in_se2():
    """Angles by the argument of a quotient of unit complex numbers."""
    first, second = random_poses(0, 3), random_poses(1, 5)
    found = scene_distances(first, second)
    for m, one in enumerate(first):
        for n, other in enumerate(second):
            total = 0.0
            for (x, y, a), (u, v, b) in zip(one, other, strict=True):
                turn = np.angle(np.exp(1j * a) / np.exp(1j * b))
                total += (x - u) ** 2 + (y - v) ** 2 + 0.01 * turn**2
            assert found[m, n] == pytest.approx(total / SIZE)


def test_a_full_turn_is_no_distance():
    poses = random_poses(2, 2)
    turned = poses + np.array([0.0, 0.0, 2 * math.pi])
    np.testing.assert_allclose(np.diag(scene_distances(poses, turned)), 0.0, atol=1e-12)
    half = poses + np.array([0.0, 0.0, math.pi])
    np.testing.assert_allclose(
        np.diag(scene_distances(poses, half)), (0.1 * math.pi) ** 2, rtol=1e-9
    )


@pytest.fixture(scope="module")
def condition():
    return random_conditions(SIZE, 1, "changed", 0)[0]


def test_the_decoder_stretches_turns_most(condition):
    """1.35 rad per unit of z beside 0.70 and 0.47 m; the same wherever it is asked."""
    arrays = take(to_arrays([condition], SIZE), 0)
    for seed in (0, 1):
        z = jax.random.normal(jax.random.key(seed), (SIZE, 3))
        assert decoder_lipschitz(lambda z: decode(z, arrays), z) == pytest.approx(1.35)


def test_the_decoder_stretches_a_wider_table_more(condition):
    wide = SceneCondition(condition.objects, width=4.0)
    arrays = take(to_arrays([wide], SIZE), 0)
    z = jnp.zeros((SIZE, 3))
    assert decoder_lipschitz(lambda z: decode(z, arrays), z) == pytest.approx(2.0)


def test_in_se2_the_decoder_shrinks(condition):
    """0.70 m per unit of z at most: 0.47 m and 0.1 * 1.35 m are less, and wrapping takes angles nearer."""
    rng = np.random.default_rng(0)
    z = rng.normal(size=(12, SIZE, 3)) * 2
    poses = np.stack([decode_exactly(one, condition) for one in z])
    square = np.sum((z[:, None] - z[None]) ** 2, axis=(2, 3)) / SIZE
    assert np.all(scene_distances(poses, poses) <= 0.70**2 * square + 1e-9)


def test_other_steps_are_refused(field, nominal, condition):
    with pytest.raises(ValueError, match="`guided` must have the steps"):
        deviation_of_scenes(nominal, TabletopGenerator(field, steps=5), [condition], 0)


@pytest.fixture(scope="module")
def found(nominal, guided):
    return deviation(nominal, guided, SIZE, "changed", CASES, 3, paths=PATHS)


@pytest.mark.slow
def test_figures_are_in_order(found):
    for part in (found.scenes, found.same):
        for one in (part.states, part.poses):
            assert one.samples == CASES
            assert 0 < one.w2 <= one.paired + 1e-9
            low, high = one.ratio_interval
            assert low <= one.ratio <= high
            low, high = one.spread_interval
            assert low <= one.spread_ratio <= high
        # The paper's decoder is linear, and its metric in SE(2) no larger than 0.70 of the one in z.
        assert part.poses.w2 <= 0.70 * part.states.w2 + 1e-9


@pytest.mark.slow
def test_the_theorem_holds(found):
    one = found.theorem
    assert one.samples == PATHS
    assert one.w2 <= one.paired + 1e-9
    assert np.log(one.paired) <= one.log_bounds.held + 1e-5
    assert one.log_bounds.held <= one.log_bounds.theorem
    assert one.decoder == pytest.approx(1.35)
    assert one.poses_w2 <= one.decoder * one.w2 + 1e-9
    assert 0 < one.integral <= one.largest


@pytest.mark.slow
def test_figures_go_into_a_file(found):
    assert json.loads(json.dumps(found.to_json()))["theorem"]["log_bounds"]["theorem"] == (
        found.theorem.log_bounds.theorem
    )
    assert found.condition == random_conditions(SIZE, 1, "changed", 3)[0].to_json()
