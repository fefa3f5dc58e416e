"""q_task and q_safe: log-sum-exp bounds, what they promise in exact geometry, gradients, extreme values."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from deggflow.tasks.bridge.factors import safe_factor, safe_margins, task_factor, task_margins

# Paper, App. on Task 1.
LENGTH, WIDTH, RADIUS, SUPPORT, CORRIDOR = 5.8, 0.72, 0.16, 0.55, 0.05
GAP_LEFT, GAP_RIGHT, HALF_HEIGHT = 0.0, 2.0, 3.0
TASK_SCALE = np.array([0.55, 0.55, 0.2, 0.2, 0.2, 0.2])
CENTRES = np.array(
    [[-2.6, 0.52], [-1.0, 0.52], [-2.0, -0.52], [-0.4, -0.52], [9.0, 9.0], [9.0, 9.0]]
)
PRESENT = np.array([True] * 4 + [False] * 2)
SMOOTH = 1e-5  # m, what |cos| and |sin| are rounded up by, times the plank's length

angles = st.floats(-4, 4) | st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi])
poses = st.tuples(st.floats(-7, 7), st.floats(-3, 3), angles)
near_the_bridge = st.tuples(st.floats(-2.2, 2.2), st.floats(-2.7, 2.7), st.floats(-0.7, 0.7))


def double(function, *arguments):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, function(*(jnp.asarray(a) for a in arguments)))


task = jax.jit(jax.value_and_grad(task_factor))
safe = jax.jit(jax.value_and_grad(safe_factor))
margins_of_task = jax.jit(task_margins)
margins_of_safe = jax.jit(safe_margins)


def corners(pose):
    """By complex numbers."""
    local = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
    local = local.real * LENGTH / 2 + 1j * local.imag * WIDTH / 2
    world = complex(pose[0], pose[1]) + np.exp(1j * pose[2]) * local
    return world.real, world.imag


def robots(pose):
    world = complex(pose[0], pose[1]) + np.exp(1j * pose[2]) * (CENTRES @ [1, 1j])[PRESENT]
    return world.real, world.imag


def exact_task(pose):
    """The six margins of the task, without smoothing."""
    x, y = corners(pose)
    way = (LENGTH / 2 - RADIUS - 0.075) * abs(math.cos(pose[2]))
    return np.array(
        [
            GAP_LEFT - x.min() - SUPPORT,
            x.max() - GAP_RIGHT - SUPPORT,
            GAP_LEFT - (pose[0] - way) - CORRIDOR,
            pose[0] + way - GAP_RIGHT - CORRIDOR,
            HALF_HEIGHT - y.max(),
            y.min() + HALF_HEIGHT,
        ]
    )


def exact_safe(pose):
    """The plank's (buffer 0.2 m) and the robots' (0.1 m) margins; the support is a plain maximum."""
    x, y = corners(pose)
    plank = [
        HALF_HEIGHT - y.max() - 0.2,
        y.min() + HALF_HEIGHT - 0.2,
        max(GAP_LEFT - x.min(), x.max() - GAP_RIGHT) - SUPPORT,
    ]
    x, y = robots(pose)
    off = RADIUS + 0.1
    return np.array(plank), np.array(
        [GAP_LEFT - off - x, HALF_HEIGHT - off - y, y + HALF_HEIGHT - off]
    )


@settings(max_examples=60, deadline=None)
@given(poses)
def test_task_margins_are_the_exact_ones(pose):
    found = double(margins_of_task, np.array(pose))
    np.testing.assert_allclose(found, exact_task(pose), atol=SMOOTH)


@settings(max_examples=60, deadline=None)
@given(poses)
def test_safe_margins_are_the_exact_ones(pose):
    """The support by a smooth maximum that is below the maximum, by 0.01 m at most where both are equal."""
    plank, found = double(margins_of_safe, np.array(pose), CENTRES, PRESENT)
    expected, of_robots = exact_safe(pose)
    np.testing.assert_allclose(plank[:2], expected[:2], atol=SMOOTH)
    np.testing.assert_allclose(found[:, PRESENT], of_robots, atol=1e-12)
    assert np.all(found[:, ~PRESENT] == np.inf)
    assert plank[2] <= expected[2] + SMOOTH
    assert plank[2] >= expected[2] - 0.01 - SMOOTH


@settings(max_examples=60, deadline=None)
@given(poses)
def test_the_task_factor_lies_between_the_bounds_of_a_log_sum_exp(pose):
    """max <= q <= max + log(M) / 80 of the scaled margins, M = 6 (paper, q_task)."""
    q, _ = double(task, np.array(pose))
    worst = np.max(-exact_task(pose) / TASK_SCALE)
    assert worst - 1e-4 <= q <= worst + math.log(6) / 80 + 1e-4


@settings(max_examples=60, deadline=None)
@given(st.lists(poses, min_size=4, max_size=4))
def test_the_safety_factor_lies_between_the_bounds_of_a_log_sum_exp(sequence):
    """M = 4 (3 + 3 N) margins, scale 0.1, sharpness 60; absent robots do not count."""
    q, _ = double(safe, np.array(sequence), CENTRES, PRESENT)
    each = [exact_safe(pose) for pose in sequence]
    worst = max(max(-plank.min(), -of_robots.min()) for plank, of_robots in each) / 0.1
    assert worst - 1e-3 <= q <= worst + 0.1 + math.log(4 * (3 + 3 * 4)) / 60 + 1e-3


@settings(max_examples=80, deadline=None)
@given(near_the_bridge)
def test_a_task_factor_of_at_most_zero_bridges(pose):
    """Exactly: support on both sides, the way beyond both edges, the plank inside."""
    q, _ = double(task, np.array(pose))
    assume(q <= 0)
    assert exact_task(pose).min() >= -1e-6  # m, as |sin| and |cos| are rounded up


def test_bridging_poses_satisfy_the_task_factor_with_little_to_spare():
    """The factor is not stricter than by its log(M) / 80: 1.2 cm of support, 0.4 cm of the rest."""
    rng = np.random.default_rng(0)
    found = 0
    for pose in rng.uniform([-1, -2.6, -0.6], [2, 2.6, 0.6], (300, 3)):
        if np.all(exact_task(pose) / TASK_SCALE >= math.log(6) / 80 + 1e-4):
            found += 1
            assert double(task, pose)[0] <= 0
    assert found > 20


@settings(max_examples=80, deadline=None)
@given(
    st.tuples(st.floats(-4, 0.0), st.floats(-2.2, 2.2), st.floats(-0.8, 0.8)),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
)
def test_a_safety_factor_of_at_most_zero_keeps_the_buffers(pose, forward, turn):
    """At each of the poses: 0.2 m around the plank, 0.1 m around the robots, support on one side."""
    sequence = np.array(pose) + np.outer(np.arange(1, 5), [forward, 0.0, turn])
    q, _ = double(safe, sequence, CENTRES, PRESENT)
    assume(q <= 0)
    for one in sequence:
        plank, of_robots = exact_safe(one)
        assert plank.min() >= -1e-6
        assert of_robots.min() >= 0


def test_both_promises_are_kept_by_some_poses():
    """So that the two tests above are not about nothing."""
    assert double(task, np.array([0.3, 0.0, 0.1]))[0] <= 0
    assert double(safe, np.array([[-3.0, 0.0, 0.1]] * 4), CENTRES, PRESENT)[0] <= 0


@settings(max_examples=40, deadline=None)
@given(poses)
def test_gradient_of_the_task_factor_is_that_of_finite_differences(pose):
    _, gradient = double(task, np.array(pose))
    # Two margins that are equal to less than a step make a kink of this size.
    check(lambda p: double(task, p)[0], np.array(pose), gradient)


@settings(max_examples=30, deadline=None)
@given(st.lists(poses, min_size=4, max_size=4))
def test_gradient_of_the_safety_factor_is_that_of_finite_differences(sequence):
    sequence = np.array(sequence)
    _, gradient = double(safe, sequence, CENTRES, PRESENT)
    direction = np.random.default_rng(0).normal(size=(4, 3))
    check(
        lambda s: double(safe, sequence + s[0] * direction, CENTRES, PRESENT)[0],
        np.zeros(1),
        np.array([np.sum(gradient * direction)]),
    )


def check(value, at, gradient):
    """Central differences of two sizes; |cos| and |sin| are rounded over 1e-6, so not across that."""
    h = 1e-8
    for k in range(len(at)):
        step = h * np.eye(len(at))[k]
        slope = (value(at + step) - value(at - step)) / (2 * h)
        assert gradient[k] == pytest.approx(slope, rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("double_precision", [False, True])
@pytest.mark.parametrize("theta", [0.0, math.pi / 2, -math.pi / 2, math.pi, 1.0])
@pytest.mark.parametrize("place", [(0.0, 0.0), (-300.0, 40.0), (1e4, -1e4)])
def test_finite_whatever_the_pose(double_precision, theta, place):
    """Exponents up to 6e6; where cos or sin vanishes; with absent robots."""
    with jax.enable_x64(double_precision):
        pose = jnp.array([*place, theta])
        four = jnp.stack([pose] * 4)
        for q, gradient in (task(pose), safe(four, jnp.asarray(CENTRES), jnp.asarray(PRESENT))):
            assert np.isfinite(q)
            assert np.isfinite(np.asarray(gradient)).all()


def test_absent_robots_change_nothing():
    pose = np.array([[-3.0, 0.4, 0.3]] * 4)
    alone = double(safe, pose, CENTRES[:4], PRESENT[:4])
    padded = double(safe, pose, CENTRES, PRESENT)
    np.testing.assert_allclose(alone[0], padded[0], atol=1e-12)
    np.testing.assert_allclose(alone[1], padded[1], atol=1e-12)
