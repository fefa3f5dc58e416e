"""Demonstrations: exact successes by an independent check, within speed limits, of all four kinds."""

import math

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from deggflow.tasks.bridge.expert import demonstrate, random_approach, random_demonstration, windows

DT, RADIUS, SPARE, EXACT = 0.2, 0.16, 0.05, 1e-9
CORNERS = np.array([2.9 + 0.36j, 2.9 - 0.36j, -2.9 - 0.36j, -2.9 + 0.36j])
WORKSPACE = box(-7, -3, 6.8, 3)
FREE = box(-7, -3, 0, 3)  # where robots may be while the bridge is built


@pytest.fixture(scope="module")
def demonstrations():
    return [random_demonstration(4 + k % 3, 2, k) for k in range(36)]


def swept(demonstration, parts):
    """Poses all along, `parts` of an action apart: chords of circles, in complex numbers."""
    x, y, theta = demonstration.condition.plank
    moves = np.repeat(demonstration.twists, parts, axis=0) * DT / parts
    angle = moves[:, 2]
    turn = theta + np.concatenate([[0.0], np.cumsum(angle)])
    chord = np.where(angle == 0, 1.0, np.expm1(1j * angle) / np.where(angle == 0, 1.0, 1j * angle))
    steps = np.exp(1j * turn[:-1]) * chord * (moves[:, 0] + 1j * moves[:, 1])
    place = complex(x, y) + np.concatenate([[0.0], np.cumsum(steps)])
    return np.stack([place.real, place.imag, turn], -1)


def planks(poses):
    world = (poses[:, 0] + 1j * poses[:, 1])[:, None] + np.exp(1j * poses[:, 2:]) * CORNERS
    return np.stack([world.real, world.imag], -1)


def robots(demonstration, poses):
    contacts = np.array(demonstration.condition.contacts)
    local = contacts[:, 0] + 0.52j * np.sign(contacts[:, 1])
    world = (poses[:, 0] + 1j * poses[:, 1])[:, None] + np.exp(1j * poses[:, 2:]) * local
    return np.stack([world.real, world.imag], -1)


def test_nothing_fails_anywhere_on_the_way(demonstrations):
    """By Shapely, also after bridging up to rest, at poses between those of the verdict; 5 cm kept."""
    room = WORKSPACE.buffer(-SPARE + 1e-3, join_style="mitre")
    free = FREE.buffer(-RADIUS - SPARE + 1e-3, join_style="mitre")
    for one in demonstrations:
        poses = swept(one, 5)
        corners = planks(poses)
        assert shapely.covers(room, shapely.polygons(corners)).all()
        assert shapely.covers(free, shapely.points(robots(one, poses))).all()
        support = np.maximum(-corners[..., 0].min(1), corners[..., 0].max(1) - 2)
        assert support.min() >= 0.55 + SPARE - 1e-3


def test_bridged_tells_the_first_action_that_bridges(demonstrations):
    for one in demonstrations:
        poses = swept(one, 1)
        x = planks(poses)[..., 0]
        way = 2.665 * np.abs(np.cos(poses[:, 2]))
        supported = (x.min(1) <= -0.55) & (x.max(1) >= 2.55)
        passable = (poses[:, 0] - way <= -0.05) & (poses[:, 0] + way >= 2.05)
        assert int(np.argmax(supported & passable)) == one.bridged
        assert 0 < one.bridged <= len(one.twists)


def test_speed_limits(demonstrations):
    """0.44 m/s and 0.32 rad/s of the plank, 0.86 m/s at the robots' centres."""
    for one in demonstrations:
        v = one.twists
        assert np.hypot(v[:, 0], v[:, 1]).max() <= 0.44 + EXACT
        assert np.abs(v[:, 2]).max() <= 0.32 + EXACT
        for x, y in one.condition.contacts:
            y = math.copysign(0.52, y)
            assert np.hypot(v[:, 0] - y * v[:, 2], v[:, 1] + x * v[:, 2]).max() <= 0.86 + EXACT


def test_from_rest_to_rest_at_the_goal(demonstrations):
    """The first and the last actions are slow, and the plank ends within a few centimetres of its goal."""
    for one in demonstrations:
        speed = np.hypot(one.twists[:, 0], one.twists[:, 1])
        assert speed[0] <= speed.max() / 3
        assert speed[-1] <= speed.max() / 3
        end = swept(one, 1)[-1]
        assert np.hypot(*(end - one.condition.goal)[:2]) <= 0.06
        assert abs(end[2] - one.condition.goal[2]) <= 0.02


def test_sides_and_turns_are_drawn_with_equal_chances():
    """Before rejection; each kind within four standard deviations of a quarter of 4,000."""
    rng = np.random.default_rng(0)
    drawn = [random_approach(rng) for _ in range(4000)]
    for side in ("left", "right"):
        for turn in ("early", "late"):
            count = sum(a.side == side and a.turn == turn for a in drawn)
            assert abs(count - 1000) <= 4 * math.sqrt(4000 * 0.25 * 0.75)


def test_all_kinds_are_among_the_demonstrations(demonstrations):
    kinds = {(one.approach.side, one.approach.turn) for one in demonstrations}
    assert len(kinds) == 4


def test_sides_and_turns_are_as_they_are_called(demonstrations):
    """At the middle of the way, left of the straight way is +y; early: more than half of the turn is done."""
    for one in demonstrations:
        poses = swept(one, 1)
        start, goal = np.array(one.condition.plank), np.array(one.condition.goal)
        along = (poses[:, 0] - start[0]) / (goal[0] - start[0])
        middle = poses[int(np.argmin(np.abs(along - 0.5)))]
        sideways = middle[1] - (start[1] + goal[1]) / 2
        assert (sideways > 0) == (one.approach.side == "left")
        if abs(goal[2] - start[2]) > 0.1:
            turned = (middle[2] - start[2]) / (goal[2] - start[2])
            assert (turned > 0.5) == (one.approach.turn == "early")


def test_decided_by_seed_size_and_number(demonstrations):
    for k in (0, 7):
        again = random_demonstration(4 + k % 3, 2, k)
        assert again.condition == demonstrations[k].condition
        np.testing.assert_array_equal(again.twists, demonstrations[k].twists)
    assert random_demonstration(4, 3, 0).condition != demonstrations[0].condition


def test_a_plan_that_fails_is_no_demonstration():
    """The detour leads into the wall."""
    rng = np.random.default_rng(1)
    one = random_demonstration(4, 0, 0)
    up = one.approach._replace(side="left", detour=4.0)
    assert demonstrate(one.condition, up) is None
    assert demonstrate(one.condition, random_approach(rng)._replace(detour=3.5)) is None


@pytest.mark.parametrize("every", [4, 7])
def test_windows_are_the_plans_at_every_replanning(demonstrations, every):
    """Each what the expert does from there on, then rest; before it the plan of the replanning before."""
    for one in demonstrations[:8]:
        now, before = windows(one, every)
        padded = np.concatenate([one.twists, np.zeros((40, 3))])
        starts = list(range(0, one.bridged, every))
        assert len(now) == len(before) == len(starts)
        for k, start in enumerate(starts):
            np.testing.assert_array_equal(now[k], padded[start : start + 20])
            if k:
                np.testing.assert_array_equal(before[k], now[k - 1])
        assert not np.any(before[0])
