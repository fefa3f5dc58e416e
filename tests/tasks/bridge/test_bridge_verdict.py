"""Exact geometry against Shapely, exact motion against matrix exponentials, and what ends a sequence of actions."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from shapely import affinity
from shapely.geometry import LineString, Point, box

from deggflow.tasks.bridge.verdict import (
    bridges,
    execute,
    integrate,
    margins,
    move,
    robot_centres,
    sub_poses,
)

RADIUS, DT, EXACT = 0.16, 0.2, 1e-9
WORKSPACE, GAP = box(-7, -3, 6.8, 3), box(0, -1e3, 2, 1e3)
LEFT, RIGHT = box(-1e3, -1e3, 0, 1e3), box(2, -1e3, 1e3, 1e3)
CONTACTS = ((-2.6, 0.36), (-0.3, 0.36), (-1.5, -0.36), (-0.9, -0.36))


def placed(shape, pose):
    turned = affinity.rotate(shape, pose[2], (0, 0), use_radians=True)
    return affinity.translate(turned, pose[0], pose[1])


def board(pose):
    return placed(box(-2.9, -0.36, 2.9, 0.36), pose)


def disks(pose):
    """Centres of the robots: 0.16 m outside their contact points."""
    return [placed(Point(x, math.copysign(0.52, y)), pose) for x, y in CONTACTS]


def random_poses(count, seed=0):
    """Anywhere, also outside the workspace and over the gap; some of them axis-aligned."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-8, -4, -7], [8, 4, 7], (count, 3))
    poses[::5, 2] = rng.integers(-4, 5, len(poses[::5])) * math.pi / 2
    poses[::3] = rng.uniform([-1.5, -3, -0.6], [1.5, 3, 0.6], (len(poses[::3]), 3))
    return poses


POSES = random_poses(250)


def grown(shape, by):
    return shape.buffer(by, join_style="mitre", mitre_limit=10)


def held_up(pose, ground):
    """How far the plank reaches over the edge of the gap onto a ground, negative where it does not."""
    part = board(pose).intersection(ground)
    if part.is_empty:
        return -board(pose).distance(ground)
    low, _, high, _ = part.bounds
    return -low if ground is LEFT else high - 2.0


def test_the_planks_margin_to_the_workspace():
    """The plank just fits into the workspace that is smaller by its margin all around."""
    found = margins(POSES, CONTACTS).plank
    for pose, margin in zip(POSES, found, strict=True):
        assert grown(WORKSPACE, -margin + EXACT).covers(board(pose))
        assert not grown(WORKSPACE, -margin - EXACT).covers(board(pose))


def test_the_support_is_that_on_either_ground_beyond_what_is_needed():
    found = margins(POSES, CONTACTS).support
    expected = [max(held_up(p, LEFT), held_up(p, RIGHT)) - 0.55 for p in POSES]
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_the_robots_margin_to_the_workspace():
    found = margins(POSES, CONTACTS).wall
    for pose, wall in zip(POSES, found, strict=True):
        for disk, margin in zip(disks(pose), wall, strict=True):
            assert grown(WORKSPACE, -margin - RADIUS + EXACT).covers(disk)
            assert not grown(WORKSPACE, -margin - RADIUS - EXACT).covers(disk)


def test_the_robots_margin_to_the_gap():
    """Distance of the disk, or minus how deep its centre is inside, minus the radius."""
    found = margins(POSES, CONTACTS).gap
    for pose, gap in zip(POSES, found, strict=True):
        for disk, margin in zip(disks(pose), gap, strict=True):
            depth = disk.distance(GAP.boundary) if GAP.covers(disk) else 0.0
            assert margin == pytest.approx(disk.distance(GAP) - depth - RADIUS, abs=EXACT)


def test_signs_of_the_margins_are_those_of_shapes():
    found = margins(POSES, CONTACTS)
    for k, pose in enumerate(POSES):
        assert (found.plank[k] >= 0) == WORKSPACE.covers(board(pose))
        for i, disk in enumerate(disks(pose)):
            body = disk.buffer(RADIUS, quad_segs=64)
            if abs(found.gap[k, i]) > 1e-3:
                assert (found.gap[k, i] < 0) == body.intersects(GAP)
            if abs(found.wall[k, i]) > 1e-3:
                assert (found.wall[k, i] < 0) != WORKSPACE.covers(body)
    assert np.any(found.least() >= 0)
    np.testing.assert_array_equal(
        found.least(),
        np.min([found.plank, found.support, *found.wall.T, *found.gap.T], axis=0),
    )


def test_bridging():
    """0.55 m of plank on both grounds, and the robots' way reaches 0.05 m beyond both edges."""
    poses = np.concatenate([POSES, random_poses(400, 1)])
    found = bridges(poses)
    for pose, bridged in zip(poses, found, strict=True):
        way = placed(LineString([(-2.665, 0), (2.665, 0)]), pose)
        low, _, high, _ = way.bounds
        supported = held_up(pose, LEFT) >= 0.55 and held_up(pose, RIGHT) >= 0.55
        assert bridged == (supported and low <= -0.05 and high >= 2.05)
    assert 20 < found.sum() < len(poses) - 20


# 2.9 cos + 0.36 sin = 1.55 = half the gap and 0.55 m
STEEPEST = math.atan2(0.36, 2.9) + math.acos(1.55 / math.hypot(0.36, 2.9))


@pytest.mark.parametrize(
    ("x", "theta", "bridged"),
    [
        (1.0, 0.0, True),
        (2.9 - 0.55 - 1e-9, 0.0, True),  # support on the left, exactly
        (2.9 - 0.55 + 1e-9, 0.0, False),
        (2.55 - 2.9 + 1e-9, 0.0, True),  # on the right
        (2.55 - 2.9 - 1e-9, 0.0, False),
        (1.0, STEEPEST - 1e-9, True),  # on both, with the plank across
        (1.0, STEEPEST + 1e-9, False),
    ],
)
def test_bridging_at_its_limits(x, theta, bridged):
    for turn in (theta, -theta, theta + math.pi):
        assert bool(bridges(np.array([x, 0.0, turn]))) == bridged


def hat(twist):
    return np.array([[0, -twist[2], twist[0]], [twist[2], 0, twist[1]], [0, 0, 0]])


def matrix(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


@pytest.mark.parametrize("omega", [0.0, 1e-13, 1e-11, 1e-6, -0.3, 2.0, 40.0])
def test_moving_is_the_matrix_exponential(omega):
    pose, twist = np.array([1.0, -2.0, 0.7]), np.array([0.3, -0.2, omega])
    for seconds in (DT, 0.05, 3.0):
        found = move(pose, twist, seconds)
        np.testing.assert_allclose(
            matrix(found), matrix(pose) @ expm(seconds * hat(twist)), atol=1e-9
        )
        assert found[2] == pytest.approx(0.7 + seconds * omega)
    parts = sub_poses(pose, twist)
    assert len(parts) >= 4
    for k, part in enumerate(parts):
        share = (k + 1) / len(parts)
        expected = matrix(pose) @ expm(share * DT * hat(twist))
        np.testing.assert_allclose(matrix(part), expected, atol=1e-9)


def test_integration_is_one_move_after_the_other():
    rng = np.random.default_rng(2)
    pose, twists = rng.normal(size=3), rng.normal(size=(30, 3))
    poses = integrate(pose, twists)
    assert len(poses) == 31
    g = matrix(pose)
    np.testing.assert_array_equal(poses[0], pose)
    for one, twist in zip(poses[1:], twists, strict=True):
        g = g @ expm(DT * hat(twist))
        np.testing.assert_allclose(matrix(one), g, atol=1e-12)


AHEAD = np.array([[0.4, 0.0, 0.0]])  # 0.08 m an action


def test_ends_at_the_first_pose_that_bridges():
    """From x = -0.6: support on the right needs x >= -0.35, four actions of 0.08 m."""
    found = execute(np.array([-0.6, 0.0, 0.0]), np.repeat(AHEAD, 20, axis=0), CONTACTS)
    assert found.bridged
    assert found.reason is None
    assert found.actions == 4
    np.testing.assert_allclose(found.poses[:, 0], -0.6 + 0.08 * np.arange(5), atol=1e-12)
    assert [bool(b) for b in bridges(found.poses)] == [False] * 4 + [True]


def test_without_an_end_all_actions_are_executed():
    found = execute(np.array([-3.5, 0.0, 0.0]), np.repeat(AHEAD, 5, axis=0), CONTACTS)
    assert (found.bridged, found.reason, found.actions) == (False, None, 5)
    nothing = execute(np.array([-3.5, 0.0, 0.0]), np.zeros((0, 3)), CONTACTS)
    assert (nothing.bridged, nothing.reason, nothing.actions) == (False, None, 0)
    assert nothing.margin == margins(nothing.poses[0], CONTACTS).least()


# What is broken first, from a start on under a constant twist.
STEEP = 1.2  # rad; the plank is too steep to bridge anywhere
ALONG = {
    "robot 4 enters the gap": ((-1.4, 0.0, STEEP), (math.cos(STEEP), -math.sin(STEEP), 0.0)),
    "the plank leaves the workspace": ((-3.5, 0.5, 0.2), (0.0, 0.0, 0.4)),
    "robot 1 leaves the workspace": ((-3.5, 2.0, 0.0), (0.0, 0.4, 0.0)),
}


@pytest.mark.parametrize("reason", ALONG)
def test_ends_at_the_first_failure_and_names_it(reason):
    start, twist = ALONG[reason]
    found = execute(np.array(start), np.tile(twist, (60, 1)), CONTACTS)
    assert not found.bridged
    assert found.reason == reason
    assert found.margin < 0
    before = execute(np.array(start), np.tile(twist, (found.actions - 1, 1)), CONTACTS)
    assert before.reason is None
    assert before.margin >= 0


def test_the_plank_alone_loses_its_support():
    """Robots stay on the left, but none of the plank is on a ground: across, over the gap."""
    contacts = ((-0.1, 0.36),)
    found = margins(np.array([[0.3, 0.0, math.pi / 2]]), contacts)
    assert found.support[0] == pytest.approx(0.36 - 0.3 - 0.55)
    pose, back = np.array([-0.25, 0.0, math.pi / 2]), np.array([[0.0, -0.4, 0.0]] * 9)
    verdict = execute(pose, back, contacts)  # body y is world -x: to the right
    assert verdict.reason == "the plank loses its support"
    assert verdict.actions == 1


@pytest.mark.parametrize("number", [1, 3])
def test_the_robot_that_leaves_the_workspace_is_named(number):
    contacts = [(-1.5, -0.36), (-1.0, -0.36), (-2.0, -0.36)]
    contacts[number - 1] = (0.1, 0.36)
    found = margins(np.array([[-4.0, 2.4, 0.0]]), contacts)
    assert int(np.argmin(found.wall[0])) == number - 1
    assert found.reason(0) == f"robot {number} leaves the workspace"
    assert found.wall[0, number - 1] == pytest.approx(3 - 2.4 - 0.52 - 0.16)


def test_what_happens_within_an_action_counts():
    """A robot that cuts the corner between two poses that are both free."""
    contacts = ((-2.0, 0.36),)
    pose = np.array([-4.0, 0.0, 0.0])
    twist = np.array([[0.0, 0.0, 2 * math.pi / DT]])  # a whole turn in one action
    assert margins(integrate(pose, twist), contacts).least().min() > 0
    turned = execute(np.array([-4.0, 1.2, 0.0]), twist, contacts)
    assert turned.reason == "the plank leaves the workspace"


def test_what_is_broken_is_named_where_it_breaks():
    """Before, the wall was nearer than the gap; the wall was not what was hit."""
    contacts = ((-0.1, 0.36),)
    start, fast = np.array([-0.5, 2.27, 0.0]), np.array([[4.0, 0.0, 0.0]])
    assert margins(start, contacts).wall[0] < margins(start, contacts).gap[0]
    found = execute(start, fast, contacts)
    assert found.reason == "robot 1 enters the gap"


def test_a_failure_within_the_action_that_bridges_is_a_failure():
    contacts = ((-0.1, 0.36),)
    start = np.array([-0.36, 0.0, 0.0])
    assert execute(start, AHEAD, CONTACTS).bridged
    found = execute(start, AHEAD * 4, contacts)
    assert bool(bridges(integrate(start, AHEAD * 4))[-1])
    assert not found.bridged
    assert found.reason == "robot 1 enters the gap"


def test_the_margin_is_the_least_of_everything_executed():
    start, twists = np.array([-3.5, 2.0, 0.0]), np.tile([0.1, 0.0, 0.1], (6, 1))
    found = execute(start, twists, CONTACTS)
    dense = [margins(found.poses[0], CONTACTS).least()]
    for pose, twist in zip(found.poses[:-1], twists, strict=True):
        dense += [margins(move(pose, twist, DT * k / 4), CONTACTS).least() for k in range(1, 5)]
    assert found.margin == pytest.approx(min(dense), abs=1e-12)


def test_centres_lie_outside_the_contact_points():
    found = robot_centres(CONTACTS)
    np.testing.assert_allclose(found[:, 0], [x for x, _ in CONTACTS])
    np.testing.assert_allclose(found[:, 1], [math.copysign(0.52, y) for _, y in CONTACTS])


def test_the_nearest_danger_is_named_with_its_distance():
    found = margins(np.array([[-3.5, 2.5, 0.0]]), CONTACTS)
    walls = 3 - 2.5 - 0.52 - 0.16
    assert found.nearest(0) == f"robot 1 to the wall, {walls:.3f} m to spare"
