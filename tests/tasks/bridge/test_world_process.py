"""The world moves the plank as the robots that are left command it."""

import json

import numpy as np
import pytest

from deggflow.tasks.bridge.observations import contact_map
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.verdict import integrate
from deggflow.tasks.bridge.world_process import PREFIX, World, encode, trial_name

[CONDITION] = random_conditions(4, 1, 0)
TWISTS = np.array([[0.02, -0.01, 0.01]] * 4)


@pytest.fixture
def world():
    return World(CONDITION, 7)


def command(robot, policy=0, lost=(), **changes):
    contact = np.array(CONDITION.contacts)[[robot]]
    values = {"velocities": (TWISTS @ contact_map(contact).T).tolist()} | changes
    name = trial_name(CONDITION, 7)
    return encode(kind="command", trial=name, policy=policy, robot=robot, lost=list(lost), **values)


def test_the_plank_follows_once_all_have_commanded(world):
    for robot in range(3):
        world.take(command(robot))
        assert world.policy == 0
    world.take(command(3))
    assert world.policy == 1
    expected = integrate(np.array(CONDITION.plank), TWISTS)
    np.testing.assert_allclose(world.rollout.poses, expected, atol=1e-12)
    told = json.loads(world.state()[len(PREFIX) :])
    assert told["policy"] == 1
    np.testing.assert_allclose(told["twists"], TWISTS, atol=1e-12)


def test_nobody_waits_for_a_robot_that_the_others_have_lost(world):
    for robot in (0, 1, 3):
        world.take(command(robot, lost=[2]))
    assert world.policy == 1
    np.testing.assert_allclose(world.rollout.twists, TWISTS, atol=1e-12)


def test_commands_of_all_but_a_silent_robot_are_carried_out(world):
    """After the deadline, `run_world` acts."""
    for robot in (0, 2):
        world.take(command(robot))
    world.act()
    np.testing.assert_allclose(world.rollout.twists, TWISTS, atol=1e-12)


def test_one_robot_alone_cannot_hold_the_plank(world):
    world.take(command(0))
    world.act()
    assert world.over
    assert not world.rollout.twists


@pytest.mark.parametrize(
    "message",
    [
        command(0, policy=1),
        command(0, velocities=[[0.0, 0.0]]),
        command(0, velocities=[[11.0, 0.0]] * 4),
        command(0, velocities="fast"),
        command(0).replace(b'"robot": 0', b'"robot": 9'),
        command(0).replace(b"7-", b"8-"),
        PREFIX + b"[1]",
        PREFIX + b"\xff",
    ],
)
def test_what_is_no_command_of_this_policy_is_dropped(world, message):
    world.take(message)
    assert not world.waiting
    assert world.policy == 0


def test_a_team_that_has_no_policy_stops_the_trial(world):
    world.take(command(1, stop=True))
    assert world.over
    name = trial_name(CONDITION, 7)
    for robot in range(4):
        assert not world.everybody_is_done
        world.take(encode(kind="done", trial=name, robot=robot))
    assert world.everybody_is_done
