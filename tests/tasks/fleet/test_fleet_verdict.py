"""The verdict in closed form against Shapely and dense time; formats; contradictions."""

import dataclasses
import json

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon, box

from deggflow.jsonl import InputError
from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.consistency import contradictions
from deggflow.tasks.fleet.formats import parse_condition, parse_plan
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.oracle import refutes
from deggflow.tasks.fleet.paths import exact_path
from deggflow.tasks.fleet.plan import Plan
from deggflow.tasks.fleet.segments import segment_from_ring
from deggflow.tasks.fleet.task import FleetTask
from deggflow.tasks.fleet.verdict import judge

NOTCHED = ((-0.6, -0.7), (-0.1, -0.7), (-0.1, -0.2), (-0.3, -0.5), (-0.6, -0.2))
FLOOR = FloorMap(boxes=((0.5, 0.5, 0.3, 0.2),), discs=((-0.5, 0.5, 0.2),), polygons=(NOTCHED,))


def random_plans(count):
    """Smooth random paths of three robots, many of which hit something."""
    rng = np.random.default_rng(3)
    styles = rng.uniform(
        (0.01, 0.02), (0.06, 0.1), (10, 2)
    )  # several plans of each are judged together
    for k in range(count):
        starts, goals = rng.uniform(-0.9, 0.9, (2, 3, 2))
        robots = tuple(Robot(tuple(a), tuple(b)) for a, b in zip(starts, goals, strict=True))
        radius, limit = styles[k % len(styles)]
        condition = FleetCondition(FLOOR, robots, float(radius), float(limit))
        yield condition, exact_path(0.3 * rng.normal(size=(3, 124)), starts, goals)


@pytest.fixture(scope="module")
def plans():
    """The same plans for all tests."""
    return list(random_plans(150))


def shapely_margins(condition, paths):
    """Least margins of each kind, by Shapely; between robots by 2,000 moments."""
    lines, radius = shapely.linestrings(paths), condition.radius
    x, y, r = FLOOR.discs[0]
    around = [box(0.35, 0.4, 0.65, 0.6), Polygon(NOTCHED)]
    obstacles = min(
        *(float(shapely.distance(lines, shape).min()) for shape in around),
        float(shapely.distance(lines, shapely.Point(x, y)).min()) - r,
    )
    time = np.linspace(0, 63, 63 * 40 + 1)
    dense = np.stack(
        [[np.interp(time, np.arange(64), path[:, k]) for k in (0, 1)] for path in paths]
    )
    pairs = [np.hypot(*(dense[a] - dense[b])).min() for a, b in ((0, 1), (0, 2), (1, 2))]
    return {
        "outside": obstacles - radius,
        "apart": min(pairs) - 2.1 * radius,
        "inside": 1 - np.abs(paths).max() - radius,
        "speed": condition.speed_limit - np.hypot(*np.diff(paths, axis=1).T).max(),
    }


def test_margins_are_those_of_shapely(plans):
    for (condition, paths), verdict in zip(plans, judge(*zip(*plans, strict=True)), strict=True):
        expected = shapely_margins(condition, paths)
        for miss in verdict.misses:
            if miss.kind == "ends":
                assert miss.margin == np.inf
            elif miss.kind == "outside" and miss.margin < -condition.radius + 1e-12:
                assert expected["outside"] <= -condition.radius + 1e-9  # both meet an obstacle
            else:  # dense time misses the least distance by a little
                slack = 2e-3 if miss.kind == "apart" else 1e-9
                assert -1e-9 <= expected[miss.kind] - miss.margin <= slack


def test_verdicts_of_a_batch_are_those_of_each_plan_alone(plans):
    elsewhere = [
        FleetCondition(name, condition.robots[:count], speed_limit=0.08)
        for name in ("dense", "highways", "empty")
        for (condition, _), count in zip(plans[:8], (3, 1, 3, 3, 2, 2, 3, 1), strict=True)
    ]
    others = [paths[: len(c.robots)] for c, (_, paths) in zip(elsewhere, plans, strict=False)]
    conditions = [condition for condition, _ in plans] + elsewhere
    paths = [paths for _, paths in plans] + others
    order = np.random.default_rng(0).permutation(len(conditions))
    together = judge([conditions[k] for k in order], [paths[k] for k in order])
    for k, verdict in zip(order, together, strict=True):
        assert verdict == judge([conditions[k]], [paths[k]])[0]


def test_plans_with_different_numbers_of_robots_are_judged_each_time(plans):
    """Shape checks look at one plan of a sequence, chosen at random."""
    counts = [1 + k % len(plans[0][1]) for k in range(len(plans))]
    conditions = [
        dataclasses.replace(condition, robots=condition.robots[:count])
        for (condition, _), count in zip(plans, counts, strict=True)
    ]
    paths = [paths[:count] for (_, paths), count in zip(plans, counts, strict=True)]
    first = judge(conditions, paths)
    assert all(judge(conditions, paths) == first for _ in range(10))


def test_the_oracle_agrees(plans):
    verdicts = judge(*zip(*plans, strict=True))
    clear = [abs(verdict.min_margin) > 1e-8 for verdict in verdicts]
    refuted = [refutes(*plan) for plan in plans]
    assert all(r != v.satisfied for r, v, c in zip(refuted, verdicts, clear, strict=True) if c)
    assert all((v.violation == 0) == v.satisfied for v in verdicts)


def test_segments_against_polygons():
    rng = np.random.default_rng(0)
    first, last = rng.uniform(-1, 1, (2, 3000, 2))
    ring = np.array(NOTCHED)
    found = segment_from_ring(first, last, ring[None])
    lines = shapely.linestrings(np.stack([first, last], axis=1))
    exact = shapely.distance(lines, Polygon(ring))
    np.testing.assert_allclose(np.maximum(found, 0), exact, atol=1e-12)


def crossing():
    """Two robots that change places on a straight line."""
    robots = (Robot((-0.5, 0.0), (0.5, 0.0)), Robot((0.5, 0.0), (-0.5, 0.0)))
    condition = FleetCondition("empty", robots)
    paths = exact_path(np.zeros((2, 124)), condition.starts, condition.goals)
    return condition, paths


def test_who_is_blocked_is_named():
    (verdict,) = judge(*([each] for each in crossing()))
    assert verdict.reason() == (
        "robot 1 misses apart (the distance to robot 2, between waypoints 32 and 33) by 0.105; "
        "blocked: robots 1, 2"
    )


def line():
    """A plan made elsewhere, as JSON."""
    condition, paths = crossing()
    paths[0, 1:-1, 1] += 0.2 * np.sin(np.linspace(0, np.pi, 64))[1:-1]
    (verdict,) = judge([condition], [paths])
    certificate = {
        "satisfied": verdict.satisfied, "min_margin": verdict.min_margin,
        "violation": verdict.violation, "draws": 1, "reason": verdict.reason(),
    }  # fmt: skip
    return json.loads(
        json.dumps(
            {"condition": condition.to_json(), "paths": paths.tolist(), "certificate": certificate, "seed": 0}
        )
    )  # fmt: skip


def test_a_line_is_what_it_says():
    row = line()
    assert row["certificate"]["satisfied"]
    assert not contradictions(row)
    assert isinstance(parse_plan(row), Plan)
    assert parse_plan(row).to_json()["paths"] == row["paths"]


@pytest.mark.parametrize(
    ("key", "value", "field"),
    [
        ("satisfied", False, "certificate.satisfied"),
        ("min_margin", 0.5, "certificate.min_margin"),
        ("violation", 0.5, "certificate.violation"),
        ("reason", "robot 1", "certificate.reason"),
    ],
)
def test_false_statements(key, value, field):
    row = line()
    row["certificate"][key] = value
    assert field in [wrong.field for wrong in contradictions(row)]


def test_a_start_that_is_missed():
    row = line()
    row["paths"][1][0][0] += 1e-9
    fields = {wrong.field for wrong in contradictions(row)}
    assert {"certificate.satisfied", "certificate.min_margin"} <= fields


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"map": "nowhere"}, "map"),
        ({"map": {"bounds": [1, 0, 0, 1]}}, "map.bounds"),
        ({"map": {"boxes": [[0, 0, 1, 0]]}}, "map.boxes[0][3]"),
        ({"map": {"polygons": [[[0, 0], [1, 1], [1, 0], [0, 1]]]}}, "map.polygons[0]"),
        ({"robots": []}, "robots"),
        ({"robots": [{"start": [0, 0]}]}, "robots[0].goal"),
        ({"radius": 0}, "radius"),
        ({"speed": 1}, "speed"),
    ],
)
def test_bad_conditions(change, field):
    value = {"map": "empty", "robots": [{"start": [0, 0], "goal": [1, 0]}], **change}
    with pytest.raises(InputError) as error:
        parse_condition(value)
    assert error.value.field == field


def test_conditions_are_compared_with_their_defaults():
    robots = [{"start": [0, 0], "goal": [1, 0]}]
    one = parse_condition({"map": "empty", "robots": robots})
    two = parse_condition(
        {"map": {"bounds": [-1, -1, 1, 1]}, "robots": robots, "radius": 0.05, "speed_limit": 0.12}
    )
    assert FleetTask.formats.difference(one, two) is None
    three = parse_condition({"map": "empty", "robots": robots, "radius": 0.06})
    assert FleetTask.formats.difference(one, three).field == "condition.radius"
