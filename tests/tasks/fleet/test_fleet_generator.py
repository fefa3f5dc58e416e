"""Plans of a reference field, the exact one of Gaussian paths: certified, repeatable, redrawn robot by robot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapely import LineString

from deggflow import requirements as req
from deggflow.tasks.fleet.condition import FleetCondition, Robot, to_arrays
from deggflow.tasks.fleet.crowding import crowding
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.generator import FleetGenerator, initial_noise
from deggflow.tasks.fleet.modes import choose
from deggflow.tasks.fleet.options import FleetFieldOptions
from deggflow.tasks.fleet.oracle import refutes
from deggflow.tasks.fleet.paths import exact_path
from deggflow.tasks.fleet.requirements import BUFFER, LAYOUT, plan_requirement
from deggflow.tasks.fleet.timing import PACE, SHIFTS, timed
from deggflow.tasks.fleet.verdict import judge

SPREAD = 0.3


def gaussian(tau, z, condition):
    """The nominal field of z(1) ~ N(0, SPREAD^2)."""
    return (tau * SPREAD**2 - (1 - tau)) / ((1 - tau) ** 2 + (tau * SPREAD) ** 2) * z


@pytest.fixture(scope="module")
def generator():
    """One compiled program for all tests."""
    return FleetGenerator(gaussian, FleetFieldOptions(evaluations=4, candidates=2))


CONDITIONS = random_conditions(3, 4, "empty", "random", seed=2)


def impossible():
    """Two robots begin too near to each other."""
    near = (Robot((0.0, 0.0), (0.5, 0.0)), Robot((0.05, 0.0), (0.0, 0.5)))
    return FleetCondition("empty", (*near, Robot((-0.5, -0.5), (-0.5, 0.5))))


def test_plans_are_certified_and_repeatable(generator):
    plans = generator.plans(CONDITIONS, seed=1, max_draws=4)
    for plan in plans:
        assert plan.certificate.satisfied
        assert not refutes(plan.condition, plan.paths)
        assert (plan.paths[:, 0] == plan.condition.starts).all()
        assert (plan.paths[:, -1] == plan.condition.goals).all()
    rest = generator.plans(CONDITIONS[1:], seed=1, first=1, max_draws=4)
    np.testing.assert_allclose(rest[0].paths, plans[1].paths, atol=1e-4)


def test_robots_that_miss_something_choose_again(generator, monkeypatch):
    """Against what the others have by then, from the same z(0); those that miss nothing keep their paths."""
    conditions = [*CONDITIONS[:2], impossible(), *CONDITIONS[2:]]
    calls, batch = [], FleetGenerator.batch

    def watched(self, noise, conditions, starts, among):
        calls.append((noise, starts, batch(self, noise, conditions, starts, among)))
        return calls[-1][-1]

    monkeypatch.setattr(FleetGenerator, "batch", watched)
    plans = generator.plans(conditions, seed=1)
    (noise, _, first), (again, starts, second) = calls
    left = [k for k, verdict in enumerate(first.verdicts) if not verdict.satisfied]
    assert 0 < len(left) < len(plans)
    np.testing.assert_array_equal(again, noise[left])
    np.testing.assert_array_equal(starts.kept, first.z[left])
    for row, k in enumerate(left):
        blocked = set(first.verdicts[k].blocked)
        assert set(np.flatnonzero(~starts.keeps[row])) == blocked
        np.testing.assert_array_equal(plans[k].paths, second.paths[row])
        assert plans[k].certificate.draws == 1
    for k in set(range(len(plans))) - set(left):
        np.testing.assert_array_equal(plans[k].paths, first.paths[k])


def test_what_is_impossible_is_blamed_on_its_robots(generator):
    (plan,) = generator.plans([impossible()], seed=1, max_draws=2)
    assert not plan.certificate.satisfied
    assert plan.certificate.draws == 2
    assert plan.verdict().blocked == (0, 1)
    assert "blocked: robots 1, 2" in plan.certificate.reason


def test_noise_of_a_robot_is_its_own():
    numbers = np.array([3, 4])
    few, many = (initial_noise(1, numbers, 0, agents, 2) for agents in (3, 6))
    np.testing.assert_array_equal(few, many[:, :, :3])
    assert not (few[0] == few[1]).any()


def test_best_responses_settle_where_nobody_gains():
    rng, reach = np.random.default_rng(0), jnp.asarray(0.6)
    paths = rng.uniform(-1, 1, (5, 4, 64, 2)).astype(np.float32)
    own = rng.uniform(0, 1e4, (5, 4))
    chosen = np.asarray(choose(jnp.asarray(own), jnp.asarray(paths), reach, jnp.ones(5, bool)))
    gap = np.linalg.norm(paths[:, :, None, None] - paths[None, None], axis=-1)
    pairs = np.sum(np.maximum(0.6 - gap, 0) ** 2, axis=-1) / BUFFER**2
    others = [[j for j in range(5) if j != k] for k in range(5)]
    costs = own + [sum(pairs[k, :, j, chosen[j]] for j in others[k]) for k in range(5)]
    assert (np.argmin(costs, axis=1) == chosen).all()
    assert (np.argmin(own, axis=1) != chosen).any()


def test_timings_stay_on_the_way_and_within_the_pace():
    (condition,) = random_conditions(3, 1, "empty", "random", seed=5)
    arrays = jax.tree.map(lambda leaf: leaf[0], to_arrays([condition]))
    z = 0.2 * np.random.default_rng(0).normal(size=(2, 3, 124)) / np.arange(1, 63).repeat(2)
    paths = [exact_path(own, condition.starts, condition.goals) for own in z]
    every = np.asarray(timed(jnp.asarray(paths, jnp.float32), arrays))
    np.testing.assert_allclose(every[0], paths, rtol=1e-6, atol=1e-6)
    ways = list(every[:, 0])
    step = np.linalg.norm(np.diff(ways, axis=2), axis=-1).max(-1)
    assert (step[1:] < np.maximum(step[0], PACE * condition.speed_limit) + 1e-5).all()
    for shift, way in zip(SHIFTS[1:], ways[1:], strict=True):
        waits = np.linalg.norm(np.diff(way, axis=1), axis=-1) < 1e-5
        assert waits[:, :6].all() if shift > 0 else waits[:, -6:].all()
        for robot, plain in zip(way, ways[0], strict=True):
            assert LineString(plain).hausdorff_distance(LineString(robot)) < 0.02


@pytest.mark.parametrize("name", ["conveyor", "dense"])
def test_guidance_sees_what_the_verdict_sees(name):
    """V at most 1/2 implies all exact margins, and V is that of all obstacles, though only the nearest are looked at."""
    rng = np.random.default_rng(1)
    conditions = random_conditions(3, 40, name, "random", seed=3)
    arrays, of = to_arrays(conditions), crowding(conditions)
    z = (0.05 * rng.normal(size=(40, 3, 124))).astype(np.float32)
    plan = plan_requirement(of)
    everything = plan_requirement(type(of)(16, polygons=False, few_discs=False))

    def values(requirement):
        return np.asarray(jax.vmap(requirement.violation)(jnp.asarray(z), arrays, arrays.mask))

    some, whole = values(plan), values(everything)
    verdicts = judge(
        conditions,
        [exact_path(one, c.starts, c.goals) for one, c in zip(z, conditions, strict=True)],
    )
    slow = [v.misses[-1].margin >= 0 for v in verdicts]
    np.testing.assert_allclose(some[slow], whole[slow], rtol=1e-4)
    assert any(slow)
    assert all(v.satisfied for v, value in zip(verdicts, some, strict=True) if value <= 0.5)
    assert all(value > 0.5 for v, value in zip(verdicts, some, strict=True) if not v.satisfied)


def test_a_layout_reads_amplitudes_of_modes():
    start, goal = np.zeros((1, 2)), np.array([[63.0, 0.0]])
    path = req.Layout(
        axes=2, waypoints=64, start=start, goal=goal, modes=np.asarray(LAYOUT.modes)
    ).paths(jnp.zeros((1, 124)))
    np.testing.assert_allclose(path[0, :, 0], np.arange(64), atol=1e-4)
    with pytest.raises(ValueError, match="`modes` must have 64 rows"):
        req.Layout(axes=2, waypoints=64, start=start, goal=goal, modes=np.ones((64, 3)))
