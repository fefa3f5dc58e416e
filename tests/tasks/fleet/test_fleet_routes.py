"""Short ways: the least of all combinations on a roadmap, points at equal distances, round corners."""

import itertools

import numpy as np
import pytest
from shapely.geometry import LineString

from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.maps import NAMED, FloorMap
from deggflow.tasks.fleet.roadmap import make_roadmap
from deggflow.tasks.fleet.routes import Search, routes
from deggflow.tasks.fleet.ways import FINE, Ways, evenly

MANY = FloorMap(
    discs=tuple((x, y, 0.02) for x in np.linspace(-0.8, 0.8, 7) for y in np.linspace(-0.8, 0.8, 7))
)
FLOORS = {**NAMED, "many": MANY}


@pytest.mark.parametrize(
    ("name", "robots", "each"),
    [("conveyor", 6, 2), ("highways", 6, 2), ("dense", 6, 2), ("many", 20, 16)],
)
def test_a_way_is_the_least_of_all_combinations(name, robots, each):
    rng = np.random.default_rng(1)
    roads = make_roadmap(FLOORS[name], rng, 2, one_way=name == "highways")
    (condition,) = random_conditions(robots, 1, "empty" if name == "many" else name, "random", 5)
    variants = np.tile([0, 1], (robots, each // 2))
    starts, goals, points = condition.starts, condition.goals, roads.points
    ways = zip(*roads.ways(np.stack([starts, goals]), variants), strict=True)
    for start, goal, of_robot in zip(starts, goals, variants, strict=True):
        into = roads.weight(np.broadcast_to(start, points.shape), points)
        out = roads.weight(points, np.broadcast_to(goal, points.shape))
        (direct,) = roads.weight(start[None], goal[None])
        least = [(into[:, None] + length + out).min() for length in roads.length]
        for variant, (corners, count) in zip(of_robot, itertools.islice(ways, each), strict=True):
            np.testing.assert_array_equal(corners[0], start)
            assert (corners[count - 1 :] == goal).all()
            inner = [int(np.argmin(np.hypot(*(points - p).T))) for p in corners[1 : count - 1]]
            np.testing.assert_array_equal(points[inner], corners[1 : count - 1])
            if not inner:
                assert direct <= least[variant]
                continue
            between = roads.length[variant]
            first, last = inner[0], inner[-1]
            assert np.isclose(into[first] + between[first, last] + out[last], least[variant])
            assert least[variant] < direct
            legs = sum(between[a, b] for a, b in itertools.pairwise(inner))
            assert np.isclose(legs, between[first, last])  # a shortest way, by its own parts
    assert next(ways, None) is None


def test_points_are_those_of_shapely():
    rng = np.random.default_rng(0)
    count = rng.integers(2, 7, 40)
    corners = rng.uniform(-1, 1, (40, 6, 2))
    corners[5, 1] = corners[5, 0]  # a move of no length
    for way, own in zip(corners, count, strict=True):
        way[own:] = way[own - 1]
    points, lengths = evenly(Ways(corners, count))
    for way, own, line_points, length in zip(corners, count, points, lengths, strict=True):
        line = LineString(way[:own])
        assert np.isclose(line.length, length)
        places = line.interpolate(np.linspace(0, 1, FINE), normalized=True)
        expected = [(place.x, place.y) for place in places]
        np.testing.assert_allclose(line_points, expected, atol=1e-12)


def test_who_stays_has_a_way():
    (points,), (length,) = evenly(Ways(np.full((1, 4, 2), 0.3), np.array([4])))
    assert length == 0
    np.testing.assert_array_equal(points, 0.3)


def test_routes_do_not_depend_on_what_is_searched_beside_them():
    conditions = [
        condition
        for name in ("dense", "empty", "conveyor", "random")
        for condition in random_conditions(4, 3, name, "random", 2)
    ]

    def search(k):
        return Search(conditions[k], np.arange(k % 3, 4), np.random.default_rng(k))

    order = np.random.default_rng(0).permutation(len(conditions))
    for k, together in zip(order, routes([search(k) for k in order], 2), strict=True):
        (alone,) = routes([search(k)], 2)
        assert together.shape == (2, 4 - k % 3, 64, 2)
        np.testing.assert_array_equal(together, alone)


def test_a_bow_leads_to_the_right_and_back():
    condition = FleetCondition("empty", (Robot((-0.5, 0.0), (0.5, 0.0)),))
    (((paths,),),) = routes([Search(condition, np.array([0]), np.random.default_rng(3))], 1)
    np.testing.assert_allclose(paths[[0, -1]], [(-0.5, 0.0), (0.5, 0.0)], atol=1e-12)
    assert (paths[1:-1, 1] < 0).all()
    assert -0.4 < paths[:, 1].min() < -0.01
    steps = np.hypot(*np.diff(paths, axis=0).T)
    assert steps.max() < 1.1 * steps.min()
