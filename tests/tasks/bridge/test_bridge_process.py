"""A complete process: stages follow each other without a jump, and end where something fails."""

from dataclasses import replace

import numpy as np
import pytest

from deggflow.certificate import GenerationRecord, LostAgent
from deggflow.tasks.bridge.assembly import assemble, plank_ticks, surroundings
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.expert import random_demonstration
from deggflow.tasks.bridge.process import TICK
from deggflow.tasks.bridge.trial import PolicyRecord, Trial, TrialCertificate
from deggflow.tasks.bridge.verdict import execute

SPEED = 0.86  # m/s, robots
CERTIFICATE = TrialCertificate(True, 0.1, 0.0, 1, None, ())


def trial_of(condition, twists):
    verdict = execute(np.array(condition.plank), twists, condition.contacts)
    return Trial(
        condition,
        twists[: verdict.actions],
        verdict.poses,
        verdict.bridged,
        verdict.reason or (None if verdict.bridged else "not bridged"),
        CERTIFICATE,
        seed=3,
    )


def touching(pose, contacts):
    """Centres of robots at their contact points, by complex numbers."""
    r = np.array(contacts)
    world = complex(pose[0], pose[1]) + np.exp(1j * pose[2]) * (r[:, 0] + 0.52j * np.sign(r[:, 1]))
    return np.stack([world.real, world.imag], -1)


@pytest.fixture(scope="module")
def trial():
    demonstration = random_demonstration(4, seed=5, number=0)
    return trial_of(demonstration.condition, demonstration.twists)


@pytest.fixture(scope="module")
def failed(trial):
    """The same start; the team pulls back over the workspace's left side."""
    backward = np.tile([-0.4, 0.0, 0.0], (60, 1))
    return trial_of(trial.condition, backward)


@pytest.fixture(scope="module")
def around(trial):
    return surroundings(trial.condition, trial.seed, 1)


@pytest.fixture(scope="module")
def process(trial, around):
    return assemble(trial, around)


def test_the_three_stages_follow_each_other_without_a_jump(trial, process):
    stages = process.stage
    assert list(dict.fromkeys(stages)) == ["approach", "build", "cross"]
    assert stages == tuple(sorted(stages))  # by chance in the order of the alphabet
    assert stages.count("build") == 2 * len(trial.twists)
    assert process.failure is None
    assert process.plank.shape == (len(stages), 3)
    assert process.robots.shape == (len(stages), 4, 2)
    speed = np.linalg.norm(np.diff(process.robots, axis=0), axis=-1) / TICK
    assert speed.max() <= SPEED + 0.15  # the plank's turning carries robots along
    np.testing.assert_allclose(process.robots[-1], process.robot_goals, atol=1e-6)


def test_the_plank_moves_while_the_bridge_is_built_and_robots_hold_on(trial, process):
    build = np.array([stage == "build" for stage in process.stage])
    moved = np.abs(np.diff(process.plank, axis=0)).max(-1) > 1e-9
    assert not moved[~build[1:]].any()
    np.testing.assert_array_equal(process.plank[0], trial.condition.plank)
    np.testing.assert_array_equal(process.plank[-1], trial.poses[-1])
    for pose, robots in zip(process.plank[build], process.robots[build], strict=True):
        np.testing.assert_allclose(robots, touching(pose, trial.condition.contacts), atol=1e-9)


def test_every_second_tick_is_a_pose_of_the_trial_and_the_others_lie_between(trial):
    ticks = plank_ticks(trial)
    np.testing.assert_array_equal(ticks[::2], trial.poses)
    step = np.abs(np.diff(trial.poses, axis=0)).max(-1)
    for neighbour in (trial.poses[:-1], trial.poses[1:]):
        away = np.abs(ticks[1::2] - neighbour).max(-1)
        np.testing.assert_allclose(away, step / 2, atol=0.01)


def test_a_failure_is_the_end(failed, around):
    process = assemble(failed, around)
    assert failed.reason is not None
    assert process.failure == failed.reason
    assert process.stage[-1] == "build"
    assert "cross" not in process.stage


def test_a_robot_that_was_lost_is_named_from_its_policy_on_and_nobody_crosses(trial, around):
    """It stays where it touches the plank."""
    record = GenerationRecord(True, "", (), 1, 0, 0, None, 0.0, 0.0)
    policies = [
        PolicyRecord(0.0, 0.0, 0.0, 1, accepted, generation=replace(record, lost=lost))
        for accepted, lost in [
            (True, ()), (False, ()), (True, (LostAgent("robot 3", 0.4),)), (True, (LostAgent("robot 3", 0.0),)),
        ]
    ]  # fmt: skip
    lossy = replace(trial, certificate=replace(CERTIFICATE, policies=tuple(policies)))
    assert lossy.lost_robots() == {2: 4}
    process = assemble(lossy, around)
    tick = process.stage.index("build") - 1 + 2 * 4
    assert process.lost_by(tick - 1) == []
    assert process.lost_by(tick) == [2]
    assert process.stage[-1] == "build"
    assert process.failure is None


def test_a_bridge_that_nobody_can_cross_ends_there(trial, around):
    """A file may claim what is not so."""
    stopped = replace(trial, twists=trial.twists[:5], poses=trial.poses[:6])
    process = assemble(stopped, around)
    assert process.failure is not None
    assert "cannot cross" in process.failure
    assert process.stage[-1] == "build"


def test_surroundings_are_decided_by_seed_and_line_alone(trial, failed, around):
    again = surroundings(failed.condition, 3, 1)
    np.testing.assert_array_equal(again.drive, around.drive)
    np.testing.assert_array_equal(again.goals, around.goals)
    for other in (surroundings(trial.condition, 4, 1), surroundings(trial.condition, 3, 2)):
        assert np.abs(other.goals - around.goals).max() > 0.01
    built = surroundings(trial.condition, 3, 1, drives=False)
    np.testing.assert_array_equal(built.goals, around.goals)
    process = assemble(trial, built)
    assert set(process.stage) == {"build"}
    assert len(process.stage) == 2 * len(trial.twists) + 1


def test_who_cannot_reach_its_contact_point_is_told(trial):
    """A robot that would stand in the gap: the process begins at the contact points."""
    condition = TrialCondition((-1.0, 0.0, 0.0), (-0.2, 0.0, 0.0), ((-2.4, 0.36), (1.5, -0.36)))
    broken = trial_of(condition, np.zeros((0, 3)))
    broken = replace(broken, success=False, reason="at the start robot 2 enters the gap")
    around = surroundings(condition, 0, 1)
    assert around.drive is None
    assert "robot 2" in around.lacking
    process = assemble(broken, around)
    assert process.stage == ("build",)
    assert process.failure == broken.reason


def test_a_bridge_that_is_there_already_is_only_crossed(trial):
    condition = replace(trial.condition, plank=(-0.2, 0.0, 0.0))
    bridged = replace(trial_of(condition, np.zeros((0, 3))), success=True, reason=None)
    process = assemble(bridged, surroundings(condition, 0, 1))
    assert list(dict.fromkeys(process.stage)) == ["approach", "cross"]
    assert process.failure is None
