"""The complete process of a trial: robots drive to the contact points, build the bridge and cross it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .condition import TrialCondition
from .drive import NoWayError, approach, contact_centres, cross, random_goals, random_starts
from .process import TICK, Process, Stage
from .trial import Trial
from .verdict import move
from .world import DT

_TICKS = round(DT / TICK)  # of an action
_DRIVES = 4  # distinguishes this use of a seed from others


class Surroundings(NamedTuple):
    """What a process contains besides its trial, independent of the guidance."""

    drive: (
        Float[np.ndarray, "ticks robots 2"] | None
    )  # to the contact points, m; None if none is shown
    goals: Float[np.ndarray, "robots 2"]  # m
    seed: int  # of the crossing
    lacking: (
        str | None
    )  # why the robots do not drive to their contact points, if one of them cannot


def surroundings(
    condition: TrialCondition, seed: int, number: int, *, drives: bool = True
) -> Surroundings:
    """Random starts and goals of robots, and their paths to the contact points.

    Args:
        condition: Of the trial.
        seed: Of the trial.
        number: Of the trial in its file; everything is determined by it and the seed.
        drives: Whether robots drive to the contact points; otherwise the process begins with the building.
    """
    rng = np.random.default_rng([seed, number, _DRIVES])
    goals = random_goals(len(condition.contacts), rng)
    plan_seed = int(rng.integers(2**31))
    if not drives:
        return Surroundings(None, goals, plan_seed, None)
    plank, contacts = np.array(condition.plank), np.array(condition.contacts)
    try:
        starts = random_starts(plank, contacts, rng)
        return Surroundings(
            approach(starts, plank, contacts, seed=plan_seed), goals, plan_seed, None
        )
    except NoWayError as error:
        return Surroundings(None, goals, plan_seed, str(error))


def plank_ticks(trial: Trial) -> Float[np.ndarray, "ticks 3"]:
    """The plank's poses while the bridge is built: the initial one, then two of every action."""
    parts = [DT * k / _TICKS for k in range(1, _TICKS)]
    between = [move(trial.poses[:-1], trial.twists, seconds) for seconds in parts]
    after = np.stack([*between, trial.poses[1:]], axis=1).reshape(-1, 3)
    return np.concatenate([trial.poses[:1], after])


def assemble(trial: Trial, around: Surroundings) -> Process:
    """The process of a trial. It ends early if the trial failed, a robot was lost, or one finds no path across.

    Args:
        trial: The building of the bridge.
        around: The rest. Without a drive to the contact points the process begins with the building.
    """
    plank = plank_ticks(trial)
    contacts = np.array(trial.condition.contacts)
    robots = np.array([contact_centres(pose, contacts) for pose in plank])
    build: list[Stage] = ["build"] * len(plank)
    before: list[Stage] = []
    first, lost_robots = 0, trial.lost_robots()
    after: list[Stage] = []
    if around.drive is not None:
        ticks = len(around.drive)  # its last moment is the first of the building
        plank = np.concatenate([np.repeat(plank[:1], ticks, axis=0), plank[1:]])
        robots = np.concatenate([around.drive, robots[1:]])
        before, build, first = ["approach"] * ticks, build[1:], ticks - 1
    failure = trial.reason
    if failure is None and around.drive is not None and not lost_robots:
        try:
            way = cross(plank[-1], contacts, around.goals, seed=around.seed)[1:]
        except NoWayError as error:
            failure = str(error)
        else:
            plank = np.concatenate([plank, np.repeat(plank[-1:], len(way), axis=0)])
            robots = np.concatenate([robots, way])
            after = ["cross"] * len(way)
    goal = np.array(trial.condition.goal)
    lost = {robot: first + _TICKS * actions for robot, actions in lost_robots.items()}
    return Process(plank, robots, (*before, *build, *after), around.goals, goal, failure, lost)
