"""Plans beside one obstacle, contact, floors of any size, many obstacles, and conditions that nobody can meet."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from PIL import Image
from shapely.geometry import LineString, Point

from deggflow.jsonl import InputError
from deggflow.tasks.fleet import obstacles
from deggflow.tasks.fleet.condition import FleetCondition, Robot, to_arrays
from deggflow.tasks.fleet.data import draw_condition
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.generator import FleetGenerator
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.obstacles import Obstacles
from deggflow.tasks.fleet.options import FleetEvaluate, FleetFieldOptions, FleetGenerate
from deggflow.tasks.fleet.oracle import refutes
from deggflow.tasks.fleet.schemes import OWN, REACH, most_of_own, own_scheme, random_scheme
from deggflow.tasks.fleet.verdict import judge

WIDE = (-100.0, -100.0, 100.0, 100.0)


def straight(*robots, floor="empty", **given):
    """A plan in which each robot goes straight from its start to its goal."""
    ends = tuple(Robot(*(tuple(map(float, end)) for end in robot)) for robot in robots)
    condition = FleetCondition(floor, ends, **given)
    path = np.linspace(condition.starts, condition.goals, 64, axis=1)
    path[:, 0], path[:, -1] = condition.starts, condition.goals
    return condition, path


def verdict(*robots, **given):
    condition, path = straight(*robots, **given)
    return judge([condition], [path])[0]


def least(found, kind):
    return next(miss.margin for miss in found.misses if miss.kind == kind)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_step_is_never_left_out(seed):
    """Plans along the axes, or standing still, toward boxes: bounds and distances are often the same number."""
    rng = np.random.default_rng(seed)
    plans, expected = [], []
    for _ in range(150):
        start = rng.integers(-99, 99, 2) / 100
        goal = start.copy()
        goal[rng.integers(2)] += rng.integers(-20, 20) / 100 * (rng.uniform() < 0.7)
        boxes = [(*rng.integers(-99, 99, 2) / 100, *rng.integers(5, 60, 2) / 100)]
        if rng.uniform() < 0.5:
            boxes.append((3.0, 3.0, 0.5, 0.5))
        floor = FloorMap(WIDE, boxes=tuple(tuple(map(float, each)) for each in boxes))
        plans.append(straight((start, goal), floor=floor, speed_limit=100.0))
        motion = LineString([start, goal]) if (start != goal).any() else Point(start)
        shapes = [shapely.box(x - w / 2, y - h / 2, x + w / 2, y + h / 2) for x, y, w, h in boxes]
        expected.append(min(shape.distance(motion) for shape in shapes) - 0.05)
    found = [least(each, "outside") for each in judge(*zip(*plans, strict=True))]
    for value, wanted in zip(found, expected, strict=True):
        if wanted > -0.05 + 1e-9:
            assert value == pytest.approx(wanted, abs=1e-12)
        else:
            assert value <= -0.05 + 1e-9


def test_contact_is_allowed():
    flush = verdict(((-0.9, -0.5), (-0.9, 0.5)), radius=0.1)
    assert flush.satisfied
    assert least(flush, "inside") == 0
    beside = [((x, -0.5), (x, 0.5)) for x in (-0.0525, 0.0525)]
    assert verdict(*beside).satisfied
    touching = FloorMap(boxes=((0.15, 0.0, 0.2, 0.2),))
    assert verdict(((0.0, -0.5), (0.0, 0.5)), floor=touching, radius=0.05).satisfied
    nearer = [((x, -0.5), (x, 0.5)) for x in (-0.0525 + 1e-12, 0.0525)]
    assert not verdict(*nearer).satisfied


def nominal(tau, z, condition):
    return -z


def test_two_floors_with_polygons_in_one_batch():
    """XLA's program for the sums over coordinates of these once wrote beyond its memory."""
    corner = ((-0.2, -0.2), (0.3, -0.2), (0.0, 0.3))
    floors = [FloorMap(polygons=(tuple((x + d, y) for x, y in corner),)) for d in (0.0, 0.1)]
    conditions = [straight(((-0.8, 0.0), (0.8, 0.05)), floor=floor)[0] for floor in floors]
    generator = FleetGenerator(nominal, FleetFieldOptions(evaluations=2, candidates=4))
    for plan in generator.plans(conditions, seed=0, max_draws=2):
        assert plan.certificate.satisfied
        assert not refutes(plan.condition, plan.paths)


def test_floors_with_more_obstacles_than_most():
    boxes = tuple((float(x), 5.0, 0.1, 0.1) for x in range(1000))
    discs = tuple((float(x), 7.0, 0.1) for x in range(1000))
    condition, _ = straight(((-0.8, 0.0), (0.8, 0.0)), floor=FloorMap(boxes=boxes, discs=discs))
    assert to_arrays([condition]).solids.shape == (1, 4096, 5)


@pytest.mark.parametrize("bounds", [(0, 0, 0.6, 0.6), (-1, -0.25, 1, 0.25), (0, 0, 20, 10)])
def test_drawn_starts_and_goals_are_within_bounds_and_reach(bounds):
    floor = FloorMap(tuple(map(float, bounds)))
    for seed in range(20):
        starts, goals = random_scheme(floor, 2, np.random.default_rng(seed))
        for points in (starts, goals):
            assert (points >= np.array(bounds[:2]) + 0.05).all()
            assert (points <= np.array(bounds[2:]) - 0.05).all()
        assert (np.hypot(*(goals - starts).T) <= REACH).all()


def test_a_floor_narrower_than_robots_is_refused():
    with pytest.raises(InputError, match="no room for robots on this map, whose bounds are"):
        random_scheme(FloorMap((0.0, 0.0, 1.0, 0.08)), 1, np.random.default_rng(0))


@pytest.mark.parametrize("name", OWN)
def test_own_starts_are_apart_or_refused(name):
    most = most_of_own(name)
    for points in own_scheme(name, most):
        away = np.linalg.norm(points[:, None] - points[None], axis=-1) + 9 * np.eye(most)
        assert away.min() >= 0.105
    with pytest.raises(
        InputError, match=f"--scheme own has room for {most} robots on {name}; got 60"
    ):
        random_conditions(60, 1, name, "own", seed=0)


def test_demonstrations_of_teams_beyond_the_largest_ring():
    rng = np.random.default_rng(0)
    assert {len(draw_condition(41, rng).robots) for _ in range(5)} == {41}


def test_runs_of_different_floors_are_different_runs(tmp_path):
    options = []
    for k in range(2):
        Image.fromarray(np.full((4, 6 + k), 255, np.uint8)).save(tmp_path / f"{k}.png")
        options.append(FleetGenerate(size=1, floor=tmp_path / f"{k}.png").settings())
    assert options[0] != options[1]
    assert "floor" not in FleetGenerate(size=1).settings()
    assert str(tmp_path) not in json.dumps(options)


def test_an_evaluation_of_nothing_is_refused():
    for given in ({"maps": ("dense",), "schemes": ("own",)}, {"maps": ()}, {"schemes": ()}):
        with pytest.raises(InputError, match="--maps and --schemes must leave something"):
            FleetEvaluate(**given)


def test_many_near_obstacles_are_looked_at_together(monkeypatch):
    rng = np.random.default_rng(0)
    rows = [rng.uniform(low, high, (12, 2)) for low, high in ((-1.0, 1.0), (0.0, 0.2))]
    radius = rng.uniform(0.0, 0.1, 12)
    x = jnp.asarray(rng.uniform(-1, 1, (2, 3, 9)), jnp.float32)
    one_by_one, at_once = (
        Obstacles(*map(jnp.float32, (*rows, radius)), nearest=count) for count in (6, 12)
    )
    expected = one_by_one.repulsion(x, 0.3, 0.01).sum(axis=0)
    monkeypatch.setattr(obstacles, "UNROLLED", 5)
    np.testing.assert_allclose(one_by_one.repulsion(x, 0.3, 0.01).sum(axis=0), expected, atol=1e-6)
    every = at_once.repulsion(x, 0.3, 0.01)
    assert every.shape == (12, 3, 8)
    assert (every.sum(axis=0) >= expected - 1e-6).all()
