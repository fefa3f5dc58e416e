"""Random trials: decided by their number, with the promised room at start and goal, judged by Shapely."""

import math

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import MultiPoint, box

from deggflow.tasks.bridge.scenes import random_conditions

WORKSPACE, LEFT = box(-7, -3, 6.8, 3), box(-7, -3, 0, 3)
RADIUS, EXACT = 0.16, 1e-9
SIZES = (2, 4, 5, 6, 8)


def placed(shape, pose):
    turned = affinity.rotate(shape, pose[2], (0, 0), use_radians=True)
    return affinity.translate(turned, pose[0], pose[1])


def board(pose):
    return placed(box(-2.9, -0.36, 2.9, 0.36), pose)


def robots(condition, pose):
    return placed(MultiPoint([(x, math.copysign(0.52, y)) for x, y in condition.contacts]), pose)


def shrunk(shape, by):
    return shape.buffer(EXACT - by, join_style="mitre")


@pytest.fixture(scope="module")
def conditions():
    return [c for size in SIZES for c in random_conditions(size, 30, 4)]


def test_as_many_robots_as_asked_for_spread_over_both_edges(conditions):
    assert [len(c.contacts) for c in conditions] == [size for size in SIZES for _ in range(30)]
    for condition in conditions:
        sides = np.array([y for _, y in condition.contacts])
        np.testing.assert_allclose(np.abs(sides), 0.36)
        assert abs(int(np.sum(np.sign(sides)))) <= 1


def test_contact_points_keep_their_range_and_distance(conditions):
    """In [-2.65, -0.1] m along the plank, 0.38 m apart on one side."""
    for condition in conditions:
        points = np.array(condition.contacts)
        assert points[:, 0].min() >= -2.65
        assert points[:, 0].max() <= -0.1
        for side in (-1, 1):
            x = np.sort(points[points[:, 1] * side > 0, 0])
            assert np.all(np.diff(x) >= 0.38 - EXACT)


def test_starts_are_on_the_initial_side_with_room(conditions):
    """The plank left of x = -0.25 m and 0.25 m off the workspace; disks 0.15 m off gap and walls."""
    for condition in conditions:
        x, _, theta = condition.plank
        assert x >= -3.85
        assert abs(theta) <= math.radians(66)
        assert board(condition.plank).bounds[2] <= -0.25 + EXACT
        assert shrunk(WORKSPACE, 0.25).covers(board(condition.plank))
        assert shrunk(LEFT, RADIUS + 0.15).covers(robots(condition, condition.plank))


def test_goals_bridge_with_room(conditions):
    """0.55 m of support on both sides, 20 degrees at most, |y| <= 2.1 m; disks still on the left ground."""
    for condition in conditions:
        _, y, theta = condition.goal
        low, _, high, _ = board(condition.goal).bounds
        assert low <= -0.55 + EXACT
        assert high >= 2.55 - EXACT
        assert abs(theta) <= math.radians(20)
        assert abs(y) <= 2.1
        assert shrunk(WORKSPACE, 0.25).covers(board(condition.goal))
        assert shrunk(LEFT, RADIUS + 0.15).covers(robots(condition, condition.goal))


def test_starts_cover_their_range(conditions):
    """Both ways to turn, all heights, both goals' sides."""
    plank, goal = (np.array([getattr(c, name) for c in conditions]) for name in ("plank", "goal"))
    for column, spread in ((0, 0.2), (1, 0.6), (2, 0.4)):
        assert plank[:, column].std() >= spread
    assert np.abs(plank[:, 2]).max() > math.radians(50)
    assert goal[:, 1].std() >= 0.8
    assert abs(np.mean(plank[:, 2] > 0) - 0.5) < 0.2
    assert abs(np.mean(goal[:, 1] > 0) - 0.5) < 0.2


def test_a_trial_is_decided_by_seed_size_and_number():
    whole = random_conditions(5, 12, 7)
    assert random_conditions(5, 12, 7) == whole
    assert random_conditions(5, 3, 7, first=6) == whole[6:9]
    assert len({c.plank for c in whole + random_conditions(5, 12, 8)}) == 24
    assert random_conditions(4, 1, 7)[0] != whole[0]
