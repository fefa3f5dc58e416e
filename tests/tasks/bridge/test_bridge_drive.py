"""Drives to the plank and over it, judged by Shapely: disks, plank, gap and workspace, also between ticks."""

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import LineString, Point, box

from deggflow.tasks.bridge.drive import (
    NoWayError,
    approach,
    contact_centres,
    cross,
    random_goals,
    random_starts,
)
from deggflow.tasks.bridge.ground import around_plank, over_bridge

RADIUS, MARGIN, SPEED, TICK = 0.16, 0.02, 0.86, 0.1  # m, m, m/s, s
EXACT = 1e-6  # m
WORKSPACE, GAP = box(-7, -3, 6.8, 3), box(0, -10, 2, 10)
LEFT, RIGHT = box(-7, -3, 0, 3), box(2, -3, 6.8, 3)
SCENES = [(robots, 0) for robots in range(2, 9)] + [(robots, 1) for robots in (3, 5, 8)]


def board(pose):
    at_origin = affinity.rotate(box(-2.9, -0.36, 2.9, 0.36), pose[2], (0, 0), use_radians=True)
    return affinity.translate(at_origin, pose[0], pose[1])


def touching(pose, contacts):
    """Centres of robots at their contact points, by complex numbers."""
    local = contacts[:, 0] + 0.52j * np.sign(contacts[:, 1])
    world = complex(pose[0], pose[1]) + np.exp(1j * pose[2]) * local
    return np.stack([world.real, world.imag], -1)


def random_scene(robots, seed):
    """Contact points, a pose on the left ground and one that bridges the gap."""
    rng = np.random.default_rng([robots, seed])
    while True:
        sides = rng.permutation(np.resize([1, -1], robots))
        contacts = np.stack([rng.uniform(-2.65, -0.1, robots), 0.36 * sides], -1)
        apart = np.abs(contacts[:, None] - contacts[None]).sum(-1) + np.eye(robots)
        if apart.min() > 0.385:
            break

    def draw(low, high, ground):
        while True:
            pose = rng.uniform(low, high)
            disks = shapely.points(touching(pose, contacts))
            inside = shrunk(ground).buffer(-0.1, join_style="mitre").covers(disks).all()
            if inside and WORKSPACE.buffer(-0.15).covers(board(pose)):
                yield pose

    start = next(p for p in draw((-3.85, -3, -1.15), (-0.25, 3, 1.15), LEFT) if on_left(p))
    bridge = next(p for p in draw((-1, -2.5, -0.7), (0.5, 2.5, 0.7), LEFT) if spans(p))
    return start, bridge, contacts


def on_left(pose):
    return board(pose).bounds[2] <= -0.25


def spans(pose):
    low, _, high, _ = board(pose).bounds
    return low <= -0.55 and high >= 2.55 and 2.665 * np.cos(pose[2]) >= 1.05 + abs(pose[0] - 1)


def check_driving(drive, starts, goals):
    """Ends, speed, and disks that keep their distance while they move straight between ticks."""
    assert np.array_equal(drive[0], starts)
    assert np.array_equal(drive[-1], goals)
    assert np.linalg.norm(np.diff(drive, axis=0), axis=-1).max() <= SPEED * TICK + EXACT
    assert WORKSPACE.buffer(EXACT - RADIUS, join_style="mitre").covers(tracks(drive)).all()
    first, second = np.triu_indices(drive.shape[1], 1)
    between = drive[:, first] - drive[:, second]
    moving = shapely.linestrings(np.stack([between[:-1], between[1:]], -2))
    assert shapely.distance(moving, Point(0, 0)).min() >= 2 * RADIUS + MARGIN - EXACT


def tracks(drive):
    return shapely.linestrings(np.swapaxes(drive, 0, 1))


def random_moves(rng, count):
    start = rng.uniform((-7.2, -3.2), (7.0, 3.2), (count, 2))
    return start, start + rng.normal(size=(count, 2)) * rng.choice([0.05, 0.5, 2.0], (count, 1))


def shrunk(ground):
    return ground.buffer(-RADIUS, join_style="mitre")


@pytest.mark.parametrize("pose", [(-3.5, 0.4, 0.0), (-3.2, -0.3, 1.1), (-3.0, 1.0, -0.4)])
def test_clear_moves_on_the_left_are_those_that_keep_off_the_plank(pose):
    start, end = random_moves(np.random.default_rng(0), 20_000)
    clear = around_plank(np.array(pose))(start, end)
    moves = shapely.linestrings(np.stack([start, end], 1))
    inside, gap = shrunk(LEFT).covers(moves), shapely.distance(moves, board(pose))
    ends = np.minimum(*(shapely.distance(shapely.points(p), board(pose)) for p in (start, end)))
    # Nothing comes nearer to the plank than the nearer end, unless by more than radius and spare room.
    assert np.array_equal(clear, inside & (gap >= np.minimum(ends, 0.18) - EXACT) & (ends >= 0.16))
    assert 0.05 < clear.mean() < 0.5


def test_clear_moves_over_the_bridge_are_on_one_ground_or_the_centre_line():
    pose, rng = (1.0, 0.5, 0.2), np.random.default_rng(0)
    start, end = random_moves(rng, 20_000)
    on_line = touching(pose, rng.uniform(-2.9, 2.9, (1000, 1)) * [1.0, 0.0])
    start[:1000] = on_line
    end[:500] = on_line[rng.permutation(500)]
    begin = touching(pose, np.array([[-1.3, 0.0]]))[0]
    clear = over_bridge(np.array([*begin, 0.2]), 2.6)(start, end)
    moves = shapely.linestrings(np.stack([start, end], 1))
    line = LineString([begin, touching(pose, np.array([[1.3, 0.0]]))[0]]).buffer(EXACT)
    grounds = shrunk(LEFT).covers(moves) | shrunk(RIGHT).covers(moves)
    assert np.array_equal(clear, grounds | line.covers(moves))
    assert line.covers(moves[clear & ~grounds]).sum() > 50


@pytest.mark.parametrize(("robots", "seed"), SCENES)
def test_robots_drive_to_the_plank(robots, seed):
    plank, _, contacts = random_scene(robots, seed)
    starts = random_starts(plank, contacts, np.random.default_rng(seed))
    drive = approach(starts, plank, contacts)
    goals = contact_centres(plank, contacts)
    np.testing.assert_allclose(goals, touching(plank, contacts), atol=1e-12)
    check_driving(drive, starts, goals)
    assert shapely.distance(tracks(drive), board(plank)).min() >= RADIUS - EXACT
    assert shapely.distance(tracks(drive), GAP).min() >= RADIUS - EXACT


@pytest.mark.parametrize(("robots", "seed"), SCENES)
def test_robots_cross_the_bridge_on_its_centre_line(robots, seed):
    _, bridge, contacts = random_scene(robots, seed)
    goals = random_goals(robots, np.random.default_rng(seed))
    drive = cross(bridge, contacts, goals)
    check_driving(drive, contact_centres(bridge, contacts), goals)
    ends = touching(bridge, np.array([[-2.9, 0.0], [2.9, 0.0]]))
    line = LineString(ends).buffer(EXACT)
    for track in tracks(drive):
        assert board(bridge).buffer(EXACT).covers(track.buffer(RADIUS).intersection(GAP))
        assert line.covers(track.intersection(GAP))


def test_starts_and_goals_are_free():
    plank, _, contacts = random_scene(8, 0)
    rng = np.random.default_rng(1)
    starts, goals = random_starts(plank, contacts, rng), random_goals(8, rng)
    for points, ground in ((starts, LEFT.difference(board(plank))), (goals, RIGHT)):
        disks = shapely.buffer(shapely.points(points), RADIUS + MARGIN / 2)
        assert ground.covers(disks).all()
        assert shapely.union_all(disks).area == pytest.approx(shapely.area(disks).sum())
    assert goals[:, 0].min() >= 3.2


def test_robots_with_free_ways_drive_straight_without_turning():
    plank = np.array([-3.5, 0.0, 0.0])
    contacts = np.array([[-2.0, 0.36], [-1.0, 0.36], [-1.0, -0.36]])
    starts = np.array([[-6.0, 2.5], [-1.5, 2.5], [-1.0, -2.5]])
    drive = approach(starts, plank, contacts)
    driven = np.linalg.norm(np.diff(drive, axis=0), axis=-1).sum(0)
    np.testing.assert_allclose(driven, np.linalg.norm(drive[-1] - starts, axis=-1), rtol=1e-9)


def test_a_robot_in_a_narrow_channel_makes_room():
    """The first robot stands in the mouth of a dead end as wide as one; the second has to get in there."""
    plank = np.array([-3.2, -2.08, 0.0])
    contacts = np.array([[-2.4, -0.36], [-1.4, -0.36]])
    mouth = touching(plank, np.array([[-2.6, -0.36]]))[0] - [0.0, 0.01]
    starts = np.stack([mouth, [-4.0, 1.0]])
    drive = approach(starts, plank, contacts)
    check_driving(drive, starts, contact_centres(plank, contacts))
    assert shapely.distance(tracks(drive), board(plank)).min() >= RADIUS - EXACT
    assert drive[:, 0, 0].min() < -6.1  # out of the channel


def test_same_seed_same_drive():
    plank, bridge, contacts = random_scene(3, 1)
    starts = random_starts(plank, contacts, np.random.default_rng(2))
    goals = random_goals(3, np.random.default_rng(2))
    twice = [approach(starts, plank, contacts, seed=3) for _ in range(2)]
    assert np.array_equal(*twice)
    twice = [cross(bridge, contacts, goals, seed=3) for _ in range(2)]
    assert np.array_equal(*twice)


ACROSS = np.array([-3.0, 0.0, np.pi / 2])  # no robot fits between the plank's ends and the walls
TWO = np.array([[-1.0, 0.36], [-2.0, 0.36]])  # both on the side away from the gap


def test_a_robot_behind_the_plank_is_named():
    starts = np.array([[-5.0, 0.0], [-1.0, 1.0]])
    with pytest.raises(NoWayError, match=r"robot 2 .*alone"):
        approach(starts, ACROSS, TWO)
    drawn = random_starts(ACROSS, TWO, np.random.default_rng(0))
    assert drawn[:, 0].max() < -3.0


def test_a_plank_that_does_not_bridge_is_refused():
    goals = np.array([[4.0, 0.0], [5.0, 0.0]])
    with pytest.raises(NoWayError, match=r"robot 1 .*does not bridge"):
        cross(np.array([-3.5, 0.0, 0.0]), TWO, goals)


@pytest.mark.parametrize(
    ("second", "said"), [((1.0, 1.0), "robot 2 .*alone"), ((4.2, 0.0), "robot 1 .*overlap robot 2")]
)
def test_impossible_goals_name_the_robot(second, said):
    with pytest.raises(NoWayError, match=said):
        cross(np.array([-0.2, 0.0, 0.0]), TWO, np.array([[4.0, 0.0], second]))
