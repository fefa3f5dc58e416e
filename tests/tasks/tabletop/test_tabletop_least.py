"""No scene closer than the bound satisfies its requirements, by Shapely; and some scene is hardly farther."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.least import least_deviation
from deggflow.tasks.tabletop.oracle import least_margin, refutes
from deggflow.tasks.tabletop.projection import project

# m, m, rad per unit of z; half the table's width and depth as compiled programs know them, in float32
HALF = np.array([np.float32(1.40) / 2, np.float32(0.94) / 2, 1.35], np.float64)

DEPTH = 0.002  # m of a violation that the cells' width may hide

DISCS = SceneCondition(("pen_cup", "desk_lamp"))
BOXES = SceneCondition(("laptop", "pencil_case"))
LONG = SceneCondition(("drawer_organizer", "drawing_board"))
MIXED = SceneCondition(("drawer_organizer", "teacup"))


def poses(z):
    return np.asarray(z, np.float64) * HALF


def near(condition, seed, spread=0.3):
    """Objects near the middle of the table, where they are in each other's way."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(len(condition.objects), 3)) * [spread, spread, 1.2]


def inside_ball(rng, count, shape, radius):
    """Points in a ball, most of them near its surface."""
    direction = rng.normal(size=(count, *shape))
    length = np.sqrt(np.sum(direction**2, axis=(1, 2), keepdims=True))
    return direction / length * radius * rng.uniform(size=(count, 1, 1)) ** 0.1


@given(st.sampled_from([DISCS, BOXES, LONG, MIXED]), st.integers(0, 10**6))
@settings(max_examples=60)
def test_nothing_within_the_bound_satisfies_the_requirements(condition, seed):
    z, rng = near(condition, seed), np.random.default_rng(seed)
    bound = least_deviation(condition, z)
    margin = least_margin(condition, poses(z))
    assert margin < 0 if bound else margin > -DEPTH
    for shift in inside_ball(rng, 60, z.shape, np.sqrt(bound) * (1 - 1e-9)) if bound else ():
        assert refutes(condition, poses(z + shift))


@given(st.integers(3, 7), st.integers(0, 10**4))
@settings(max_examples=25)
def test_nothing_within_the_bound_of_larger_scenes_does(size, seed):
    (condition,) = random_conditions(size, 1, "changed", seed)
    z, rng = near(condition, seed, 0.45), np.random.default_rng(seed)
    bound = least_deviation(condition, z)
    for shift in inside_ball(rng, 40, z.shape, np.sqrt(bound) * (1 - 1e-9)) if bound else ():
        assert refutes(condition, poses(z + shift))


def solved(condition, z, seed):
    """The least squared distance that a general solver finds, where Shapely measures one margin for all."""
    rng, best = np.random.default_rng(seed), math.inf
    for attempt in range(4):
        start = z + (0.02 if attempt == 0 else 0.15) * rng.normal(size=z.shape)
        found = minimize(
            lambda x: np.sum((x - z.ravel()) ** 2), start.ravel(), method="SLSQP",
            constraints={"type": "ineq", "fun": lambda x: least_margin(condition, poses(x.reshape(z.shape)))},
            options={"maxiter": 60},
        )  # fmt: skip
        if not refutes(condition, poses(found.x.reshape(z.shape))):
            best = min(best, found.fun)
    return best


@pytest.mark.parametrize("seed", range(6))
def test_a_solver_finds_no_less(seed):
    for condition in (DISCS, MIXED):
        z = near(condition, seed, 0.15)
        assert solved(condition, z, seed) >= least_deviation(condition, z) - 1e-9


def test_an_object_over_the_edge_must_come_back():
    """A pen cup of radius 0.034 m, 0.01 m over the right edge, its region on the table's side."""
    z = np.array([[0.70 - 0.034 + 0.01, 0.0, math.pi]]) / HALF
    only = SceneCondition(("pen_cup",))
    assert least_deviation(only, z) == pytest.approx((0.01 / HALF[0]) ** 2, rel=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 2])
def test_two_discs_that_overlap_share_the_way(turn):
    """A cup and a lamp whose regions look away from each other, 0.02 m too close along the direction of the offset.

    Both move by half: (0.02 / rho)^2 / 2 at most, less where a steeper direction is cheaper.
    """
    direction = np.array([math.cos(turn), math.sin(turn)])
    away = (0.034 + 0.06 - 0.02) * direction
    z = np.stack([[0.0, 0.0, turn + math.pi], [*away, turn + math.pi / 2]]) / HALF
    bound = least_deviation(DISCS, z)
    angle = np.linspace(-np.pi, np.pi, 200_001)
    missing = 0.094 - away @ np.stack([np.cos(angle), np.sin(angle)])
    rho = np.hypot(HALF[0] * np.cos(angle), HALF[1] * np.sin(angle))
    exact = np.min(missing / rho) ** 2 / 2
    assert bound <= exact * (1 + 1e-9)
    assert bound == pytest.approx(exact, rel=0.02)


def test_more_cells_give_larger_bounds():
    z = near(LONG, 3, 0.15)
    few, many = (least_deviation(LONG, z, cells=cells) for cells in (90, 2880))
    assert 0.9 * many < few <= many * (1 + 1e-9)


def test_a_projection_is_accepted_and_no_closer_than_the_bound():
    conditions = random_conditions(4, 24, "changed", 5)
    z = np.stack([near(condition, k, 0.5) for k, condition in enumerate(conditions)])
    found = project(conditions, z, z)
    square = np.sum((found - z) ** 2, axis=(1, 2))
    bound = np.array([least_deviation(*each) for each in zip(conditions, z, strict=True)])
    assert np.mean(np.isfinite(square)) > 0.9
    assert np.all((square >= bound) | np.isnan(square))
    for condition, one in zip(conditions, found, strict=True):
        assert np.any(np.isnan(one)) or not refutes(condition, poses(one))


def test_a_scene_that_satisfies_its_requirements_stays_where_it_is():
    (condition,) = random_conditions(2, 1, "default", 0)
    z = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    assert not refutes(condition, poses(z))
    np.testing.assert_array_equal(project([condition], z[None], z[None])[0], z)
    assert least_deviation(condition, z) == 0.0
