"""Random trials: plank, goal and contact points, by rejection sampling (paper, App. on Task 1)."""

import math

import numpy as np
from jaxtyping import Float

from .condition import TrialCondition
from .verdict import bridges, margins
from .world import (
    CONTACT_SIDE,
    CONTACT_SPACING,
    CONTACT_X_MAX,
    CONTACT_X_MIN,
    PLANK_LENGTH,
    PLANK_WIDTH,
)

START_ANGLE, GOAL_ANGLE = math.radians(66.0), math.radians(20.0)  # rad, either way
START_X_MIN, START_X_MAX = -3.85, -0.25  # m; the plank's front end is left of the latter
GOAL_Y = 2.1  # m, either way
GOAL_X = (-0.6, 0.3)  # m, where goals are tried
PLANK_SPARE, ROBOT_SPARE = (
    0.25,
    0.15,
)  # m kept at start and goal, a little more than the factors ask
_TRIES = 256


def _contacts(robots: int, rng: np.random.Generator) -> Float[np.ndarray, "robots 2"]:
    """Contact points spread over both long edges, in random order."""
    sides = np.resize([1.0, -1.0], robots) * rng.choice([-1.0, 1.0])
    x = np.empty(robots)
    for side in (-1.0, 1.0):
        here = sides == side
        count = int(here.sum())
        # Uniform under the spacing: sorted points in the length that the spacings leave.
        room = CONTACT_X_MAX - CONTACT_X_MIN - (count - 1) * CONTACT_SPACING
        order = np.sort(rng.uniform(0.0, room, count)) + CONTACT_SPACING * np.arange(count)
        x[here] = rng.permutation(CONTACT_X_MIN + order)
    order = rng.permutation(robots)
    return np.stack([x, CONTACT_SIDE * sides], -1)[order]


def _roomy(
    poses: Float[np.ndarray, "tries 3"], contacts: Float[np.ndarray, "robots 2"]
) -> np.ndarray:
    distances = margins(poses, contacts.tolist())
    robots = np.minimum(distances.wall.min(-1), distances.gap.min(-1))
    return (distances.plank >= PLANK_SPARE) & (distances.support >= 0) & (robots >= ROBOT_SPARE)


def _first(good: np.ndarray, poses: Float[np.ndarray, "tries 3"]) -> tuple[float, float, float]:
    x, y, theta = poses[int(np.argmax(good))].tolist()
    return x, y, theta


def random_condition(robots: int, rng: np.random.Generator) -> TrialCondition:
    """A trial whose start and goal leave slightly more room than the factors require."""
    while True:
        contacts = _contacts(robots, rng)
        theta = rng.uniform(-START_ANGLE, START_ANGLE, _TRIES)
        reach = (PLANK_LENGTH * np.cos(theta) + PLANK_WIDTH * np.abs(np.sin(theta))) / 2
        x = rng.uniform(START_X_MIN, START_X_MAX, _TRIES)
        starts = np.stack([x, rng.uniform(-3.0, 3.0, _TRIES), theta], -1)
        good_start = (x <= START_X_MAX - reach) & _roomy(starts, contacts)
        goals = np.stack(
            [
                rng.uniform(*GOAL_X, _TRIES),
                rng.uniform(-GOAL_Y, GOAL_Y, _TRIES),
                rng.uniform(-GOAL_ANGLE, GOAL_ANGLE, _TRIES),
            ],
            -1,
        )
        good_goal = bridges(goals) & _roomy(goals, contacts)
        if good_start.any() and good_goal.any():
            points = tuple((float(a), float(b)) for a, b in contacts)
            return TrialCondition(_first(good_start, starts), _first(good_goal, goals), points)


def random_conditions(robots: int, count: int, seed: int, first: int = 0) -> list[TrialCondition]:
    """Trials number `first` to `first + count - 1` of a seed; each depends on its own number alone."""
    return [
        random_condition(robots, np.random.default_rng([seed, robots, number]))
        for number in range(first, first + count)
    ]
