"""Demonstrations: plans that pass left or right of the straight path and turn early or late.

A plan is a path of plank poses over progress p in [0, 1]; the expert follows it under speed limits, from
rest to rest. Demonstrations bridge the gap and keep a distance to every failure, by exact geometry.
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from .condition import TrialCondition
from .scenes import random_condition
from .verdict import execute, integrate, margins, robot_centres
from .world import ANGULAR_SPEED, DT, HORIZON, LINEAR_SPEED, ROBOT_SPEED

Side = Literal["left", "right"]  # seen from the start toward the gap: left is +y
Turn = Literal["early", "late"]
SIDES: tuple[Side, ...] = ("left", "right")

DETOUR = (0.35, 1.1)  # m, sideways at the middle of the path
PACE = (0.6, 0.95)  # proportion of the speed limits that is used
TURNS: dict[Turn, tuple[float, float]] = {"early": (0.0, 0.55), "late": (0.4, 0.95)}
RAMP = 6  # actions over which the expert speeds up
SETTLING = 1.2  # 1/s, rate at which the remaining path is covered near the goal
MAX_ACTIONS = 200
ARRIVED = 0.005  # of the path
SPARE = 0.05  # m, least distance to failure that a demonstration keeps
ATTEMPTS = 12  # plans tried for one trial before another trial is drawn


class Approach(NamedTuple):
    """How a demonstration approaches the goal."""

    side: Side
    turn: Turn
    detour: float  # m
    pace: float


class Demonstration(NamedTuple):
    """A trial solved by the expert: body twists until rest at the goal, and the time at which the gap is bridged."""

    condition: TrialCondition
    approach: Approach
    twists: Float[np.ndarray, "actions 3"]
    bridged: int  # actions after which the plank bridges the gap
    seed: int
    number: int


def _ease(p: float) -> float:
    p = min(max(p, 0.0), 1.0)
    return p * p * (3 - 2 * p)


def _pose(condition: TrialCondition, approach: Approach, p: float) -> Float[np.ndarray, " 3"]:
    """The plan's pose at progress p."""
    start, goal = np.array(condition.plank), np.array(condition.goal)
    begin, end = TURNS[approach.turn]
    sideways = approach.detour * np.sin(np.pi * p) * (1 if approach.side == "left" else -1)
    along = start + (goal - start) * [p, _ease(p), _ease((p - begin) / (end - begin))]
    return along + [0.0, sideways, 0.0]


def _twist(
    before: Float[np.ndarray, " 3"], after: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Constant body twist that leads from one pose to the other in one action (logarithm of SE(2))."""
    dx, dy, turn = after - before
    cos, sin = np.cos(before[2]), np.sin(before[2])
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    half = turn / 2
    h = half / np.tan(half) if abs(half) > 1e-9 else 1.0
    return np.array([h * ahead + half * aside, h * aside - half * ahead, turn]) / DT


def _fastest(twist: Float[np.ndarray, " 3"], r: Float[np.ndarray, "robots 2"]) -> float:
    """The factor by which a twist can be scaled until it meets the first limit."""
    robots = np.hypot(twist[0] - r[:, 1] * twist[2], twist[1] + r[:, 0] * twist[2]).max()
    loads = (
        np.hypot(twist[0], twist[1]) / LINEAR_SPEED,
        abs(twist[2]) / ANGULAR_SPEED,
        robots / ROBOT_SPEED,
    )
    return 1 / max(*loads, 1e-9)


def follow(condition: TrialCondition, approach: Approach) -> Float[np.ndarray, "actions 3"]:
    """Body twists along the plan, from rest to rest."""
    r = robot_centres(condition.contacts)
    p, twists, pose = 0.0, [], _pose(condition, approach, 0.0)
    probe = 0.01
    for action in range(MAX_ACTIONS):
        ahead = _twist(pose, _pose(condition, approach, p + probe))
        step = probe * _fastest(ahead, r) * approach.pace * min(1.0, (action + 1) / RAMP)
        p = p + min(step, SETTLING * DT * (1 - p))
        after = _pose(condition, approach, p)
        twists.append(_twist(pose, after))
        pose = after
        if 1 - p < ARRIVED:
            break
    return np.array(twists)


def random_approach(rng: np.random.Generator) -> Approach:
    """A random approach: both sides and both turns have equal probabilities."""
    side: Side = "left" if rng.random() < 0.5 else "right"
    turn: Turn = "early" if rng.random() < 0.5 else "late"
    return Approach(side, turn, rng.uniform(*DETOUR), rng.uniform(*PACE))


def demonstrate(condition: TrialCondition, approach: Approach) -> tuple[np.ndarray, int] | None:
    """Twists and the number of actions until the gap is bridged; None unless the whole plan succeeds."""
    twists = follow(condition, approach)
    verdict = execute(np.array(condition.plank), twists, condition.contacts)
    if not verdict.bridged or verdict.margin < SPARE:
        return None
    # Motion after the bridging is part of the plans that the field learns, so it must be as safe.
    poses = integrate(np.array(condition.plank), twists)[verdict.actions :]
    if margins(poses, condition.contacts).least().min() < SPARE:
        return None
    return twists, verdict.actions


def random_demonstration(robots: int, seed: int, number: int) -> Demonstration:
    """A demonstration of a random trial, determined by seed and number alone."""
    rng = np.random.default_rng([seed, robots, number, 1])
    while True:
        condition = random_condition(robots, rng)
        for _ in range(ATTEMPTS):
            approach = random_approach(rng)
            solution = demonstrate(condition, approach)
            if solution is not None:
                return Demonstration(condition, approach, *solution, seed, number)


def windows(
    demonstration: Demonstration, every: int
) -> tuple[Float[np.ndarray, "windows horizon 3"], Float[np.ndarray, "windows horizon 3"]]:
    """Plans at every replanning until the gap is bridged, and the plans before them (at first: rest)."""
    rest = np.zeros((HORIZON, 3))
    twists = np.concatenate([np.zeros((every, 3)), demonstration.twists, rest])
    starts = range(0, demonstration.bridged, every)
    now = np.array([twists[k + every : k + every + HORIZON] for k in starts])
    before = np.array([twists[k : k + HORIZON] for k in starts])
    before[0] = 0.0
    return now, before
