"""lambda_i, pi_ij and c_i entry by entry against the paper's formulas, in a second implementation."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.bridge.condition import (
    BridgeCondition,
    Scales,
    TrialCondition,
    centres,
    observe,
    padded_robots,
    to_arrays,
)

# Paper, App. on Task 1.
X_MIN, X_MAX, Y_MIN, Y_MAX = -7.0, 6.8, -3.0, 3.0
X, Y = 6.9, 3.0
GAP_L, GAP_R, GOAL_MIN = 0.0, 2.0, 3.2
LENGTH, WIDTH, RADIUS = 5.8, 0.72, 0.16
T = 20

rng = np.random.default_rng(0)
SCALES = Scales(
    continuation_mean=tuple(rng.normal(size=2 * T).tolist()),
    continuation_std=tuple(rng.uniform(0.1, 2.0, 2 * T).tolist()),
)


def random_state(seed, robots=4, agents=6):
    """Anywhere, in motion, with a continuation; what stands in the padding is zero."""
    rng = np.random.default_rng([seed, robots])
    contacts, mask = np.zeros((agents, 2)), np.zeros(agents, bool)
    sides = rng.choice([-0.36, 0.36], robots)
    contacts[:robots] = np.stack([rng.uniform(-2.65, 2.65, robots), sides], -1)
    mask[:robots] = True
    return BridgeCondition(
        rng.uniform([-6, -2.5, -7], [5, 2.5, 7]),
        rng.normal(size=3) * 0.3,
        rng.uniform([-1, -2, -0.4], [0.5, 2, 0.4]),
        contacts,
        mask,
        rng.normal(size=(T, 3)) * 0.3,
    )


@jax.jit
def _observed(condition):
    return observe(condition, SCALES)


def observed(condition):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _observed(jax.tree.map(jnp.asarray, condition)))


def cross(omega, r):
    return np.array([-omega * r[1], omega * r[0]])


class Robot:
    """Position and velocity in the world of a robot whose disk touches its contact point from outside."""

    def __init__(self, state, i):
        self.pose, self.twist, r = state.plank, state.twist, state.contacts[i]
        cos, sin = math.cos(self.pose[2]), math.sin(self.pose[2])
        self.rotation = np.array([[cos, -sin], [sin, cos]])
        local = np.array([r[0], math.copysign(WIDTH / 2 + RADIUS, r[1])])
        self.p = self.pose[:2] + self.rotation @ local
        # v_B^w and omega, then a rigid body's velocity field in the world frame.
        plank_velocity = self.rotation @ self.twist[:2]
        self.v = plank_velocity + cross(self.twist[2], self.p - self.pose[:2])
        if self.p[0] <= GAP_L:
            self.ground = [1.0, 0.0, 0.0]
        elif self.p[0] < GAP_R:
            self.ground = [0.0, 1.0, 0.0]
        else:
            self.ground = [0.0, 0.0, 1.0]


def bridged(pose):
    """Support of 0.55 m on both sides, and the robots' way reaches 0.05 m beyond both edges."""
    x, _, theta = pose
    reach = (LENGTH * abs(math.cos(theta)) + WIDTH * abs(math.sin(theta))) / 2
    way = (LENGTH / 2 - RADIUS - 0.075) * abs(math.cos(theta))
    return (
        x - reach <= GAP_L - 0.55
        and x + reach >= GAP_R + 0.55
        and x - way <= GAP_L - 0.05
        and x + way >= GAP_R + 0.05
    )


def own_by_hand(state, i):
    """lambda_i, 23 entries."""
    robot = Robot(state, i)
    x, y, theta = state.plank
    position = robot.rotation.T @ (robot.p - state.plank[:2])
    velocity = robot.rotation.T @ robot.v
    return [
        position[0] / X, position[1] / Y,
        velocity[0] / 0.86, velocity[1] / 0.86,
        *robot.ground,
        state.twist[0] / 0.44, state.twist[1] / 0.44,
        state.twist[2] / 0.32,
        float(bridged(state.plank)),
        1.0,
        math.cos(theta), -math.sin(theta), math.sin(theta), math.cos(theta),
        (X_MIN - x) / X, (GAP_L - x) / X, (GAP_R - x) / X, (GOAL_MIN - x) / X, (X_MAX - x) / X,
        (Y_MIN - y) / Y, (Y_MAX - y) / Y,
    ]  # fmt: skip


def other_by_hand(state, i, j):
    """pi_ij, 8 entries."""
    one, two = Robot(state, i), Robot(state, j)
    position = one.rotation.T @ (two.p - one.p)
    velocity = one.rotation.T @ (two.v - one.v)
    return [
        position[0] / X, position[1] / Y,
        velocity[0] / 0.86, velocity[1] / 0.86,
        *two.ground,
        1.0,
    ]  # fmt: skip


def shortest_turn(angle):
    """In (-pi, pi], by whole turns."""
    while angle > math.pi:
        angle -= 2 * math.pi
    while angle <= -math.pi:
        angle += 2 * math.pi
    return angle


def contact_by_hand(state, i):
    """c_i, 45 entries; vec stacks the two columns of the standardised continuation."""
    r = state.contacts[i]
    jacobian = np.array([[1.0, 0.0, -r[1]], [0.0, 1.0, r[0]]])
    rotation = Robot(state, i).rotation
    gap = rotation.T @ (state.goal[:2] - state.plank[:2])
    mean = np.array(SCALES.continuation_mean).reshape(T, 2)
    std = np.array(SCALES.continuation_std).reshape(T, 2)
    ahead = []
    for component in range(2):
        for t in range(T):
            velocity = (jacobian @ state.continuation[t])[component]
            ahead.append((velocity - mean[t, component]) / std[t, component])
    return [
        r[0] / (LENGTH / 2),
        1.0 if r[1] > 0 else -1.0,
        gap[0] / LENGTH,
        gap[1] / Y,
        shortest_turn(state.goal[2] - state.plank[2]) / (math.pi / 3),
        *ahead,
    ]


STATES = [random_state(seed, robots) for seed, robots in enumerate((2, 4, 4, 5, 6, 6))]
# One that bridges, robots on all grounds, at rest or not.
STATES += [random_state(9, 6)._replace(plank=np.array([0.3, 1.0, 0.2]))]


@pytest.mark.parametrize("state", STATES)
def test_every_entry_is_the_papers(state):
    seen, robots = observed(state), int(state.mask.sum())
    assert [leaf.shape for leaf in seen] == [(6, 23), (6, 6, 8), (6, 45)]
    for i in range(robots):
        np.testing.assert_allclose(seen.own[i], own_by_hand(state, i), atol=1e-12)
        np.testing.assert_allclose(seen.contact[i], contact_by_hand(state, i), atol=1e-12)
        for j in range(robots):
            if j != i:
                np.testing.assert_allclose(seen.other[i, j], other_by_hand(state, i, j), atol=1e-12)


def test_states_cover_bridging_and_all_grounds():
    """So that the entries above are not zero throughout."""
    grounds = {tuple(Robot(s, i).ground) for s in STATES for i in range(int(s.mask.sum()))}
    assert len(grounds) == 3
    assert {bridged(s.plank) for s in STATES} == {True, False}


def test_absent_robots_are_zero_and_change_nothing():
    small, large = random_state(3, 4, 6), random_state(3, 4, 8)
    a, b = observed(small), observed(large)
    for one, other in zip(a, b, strict=True):
        present = tuple(slice(0, 4) for _ in range(one.ndim - 1))
        np.testing.assert_array_equal(one[present], other[present])
    assert np.all(b.own[4:] == 0)
    assert np.all(b.contact[4:] == 0)
    assert np.all(b.other[4:] == 0)
    assert np.all(b.other[:, 4:] == 0)


def test_a_permutation_of_the_robots_permutes_what_they_read():
    state, order = random_state(5, 6), np.array([3, 0, 5, 1, 4, 2])
    a = observed(state)
    b = observed(state._replace(contacts=state.contacts[order], mask=state.mask[order]))
    np.testing.assert_allclose(b.own, a.own[order], atol=1e-15)
    np.testing.assert_allclose(b.contact, a.contact[order], atol=1e-15)
    np.testing.assert_allclose(b.other, a.other[order][:, order], atol=1e-15)


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
@pytest.mark.parametrize("difference", [0.0, 1.0, -1.0, 3.1, -3.1])
def test_the_goals_angle_is_the_shortest_turn(turns, difference):
    state = random_state(1)
    goal = np.array([0.0, 0.0, state.plank[2] + difference + 2 * math.pi * turns])
    turn = observed(state._replace(goal=goal)).contact[0, 4] * math.pi / 3
    assert turn == pytest.approx(difference, abs=1e-9)


@pytest.mark.parametrize("half_turn", [math.pi, -math.pi])
def test_half_a_turn_counts_as_plus_pi(half_turn):
    """(-pi, pi], closed above: exact in floating point where the plank lies along the axis."""
    state = random_state(1)
    state = state._replace(plank=np.array([-3.0, 0.0, 0.0]), goal=np.array([0.0, 0.0, half_turn]))
    assert observed(state).contact[0, 4] == pytest.approx(3.0, abs=1e-12)


def test_robots_touch_their_contact_points_from_outside():
    """At a distance of 0.16 m, across the long edge, on the side of the contact point."""
    contacts = np.array([[-2.0, 0.36], [-0.5, -0.36]])
    found = np.asarray(centres(jnp.asarray(contacts)))
    np.testing.assert_allclose(found, [[-2.0, 0.52], [-0.5, -0.52]], atol=1e-6)


def test_trials_start_at_rest_and_padded():
    trials = [
        TrialCondition((-3.0, 0.5, 0.1), (0.0, 1.0, -0.2), ((-1.0, 0.36), (-2.0, -0.36))),
        TrialCondition(
            (-2.5, 0.0, 0.4), (0.1, 0.0, 0.0), ((-1.5, 0.36), (-1.0, 0.36), (0.0, -0.36))
        ),
    ]
    arrays = to_arrays(trials, 6)
    assert arrays.contacts.shape == (2, 6, 2)
    np.testing.assert_array_equal(arrays.mask.sum(axis=1), [2, 3])
    assert not np.any(arrays.twist)
    assert not np.any(arrays.continuation)
    for k, trial in enumerate(trials):
        np.testing.assert_allclose(arrays.plank[k], trial.plank, atol=1e-6)
        np.testing.assert_allclose(arrays.goal[k], trial.goal, atol=1e-6)
        n = len(trial.contacts)
        np.testing.assert_allclose(arrays.contacts[k, :n], trial.contacts, atol=1e-6)
        assert not np.any(arrays.contacts[k, n:])


def test_teams_are_padded_to_six_or_eight():
    assert [padded_robots(n) for n in range(2, 9)] == [6] * 5 + [8] * 2
