"""Starts and goals of drawn conditions: MMD's own scheme of each named map, and random ones.

Source: yoraish/mmd (MMD, ICLR 2025) for the schemes of its four maps.
"""

from functools import cache

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError

from .clearance import clearance
from .condition import APART, MAX_ROBOTS, SPEED_LIMIT
from .maps import RADIUS, FloorMap
from .paths import WAYPOINTS

OWN = ("empty", "conveyor", "highways", "drop_region")  # named maps with a scheme of their own
SPACING = 0.15  # map units, least distance of random starts, and of random goals
ROOM = 0.16  # map units, least distance of random starts and goals from obstacles
_EDGE = 0.9  # largest coordinate of random points, of the map's half width
_WALL = 0.1  # map units, least distance of random points from the bounds
REACH = (
    0.75 * (WAYPOINTS - 1) * SPEED_LIMIT
)  # map units, largest distance of a random goal from its start
_ATTEMPTS = 200

Points = Float[np.ndarray, "robots 2"]


def _ring(count: int, radius: float) -> Points:
    angle = 2 * np.pi * np.arange(count) / max(count, 1)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def own_scheme(name: str, count: int) -> tuple[Points, Points]:
    """Starts and goals of `count` robots as MMD places them on one of its maps (`OWN`).

    Example:
        >>> own_scheme("empty", 2)[1].round(3).tolist()
        [[-0.8, -0.0], [0.8, -0.0]]
    """
    if name == "highways":  # two rings, goals opposite
        start = np.concatenate([_ring(min(count, 10), 0.45), _ring(max(count - 10, 0), 0.65)])
        return start, -start
    start = _ring(count, 0.8)
    if name == "empty":
        return start, -start
    robot, axis = np.arange(count), np.argmax(np.abs(start), axis=1)
    start[robot, axis] = 0.87 * np.sign(start[robot, axis])
    goal = start.copy()
    goal[robot, axis] *= -1  # mirrored across the floor
    return start, goal


@cache
def most_of_own(name: str) -> int:
    """The largest team whose starts, by a map's own scheme, are as far apart as robots must be.

    Example:
        >>> most_of_own("empty")
        47
    """
    return max(
        count
        for count in range(2, MAX_ROBOTS + 1)
        if _least_distance(own_scheme(name, count)[0]) >= APART * RADIUS
    )


def _least_distance(points: Points) -> float:
    away = np.hypot(*np.moveaxis(points[:, None] - points[None], -1, 0))
    return float(np.min(away[np.triu_indices(len(points), 1)]))


def random_points(
    floor: FloorMap, count: int, rng: np.random.Generator, starts: Points | None = None
) -> Points:
    """Random places at least `SPACING` apart and `ROOM` from obstacles, within `REACH` of the robots' starts.

    Raises:
        InputError: The floor has too little room.
    """
    low, high = np.reshape(floor.bounds, (2, 2))
    half = (high - low) / 2
    middle, half = (low + high) / 2, np.minimum(_EDGE * half, half - _WALL)
    if (half < 0).any():
        raise InputError(f"no room for robots on this map, whose bounds are {[*floor.bounds]}")
    for _ in range(_ATTEMPTS):
        points = middle + half * rng.uniform(-1.0, 1.0, (40 * count, 2))
        points = points[clearance(floor, points) >= ROOM]
        chosen: list[Float[np.ndarray, " 2"]] = []
        for point in points:
            near = starts is None or np.hypot(*(point - starts[len(chosen)])) <= REACH
            if near and all(np.hypot(*(point - other)) >= SPACING for other in chosen):
                chosen.append(point)
            if len(chosen) == count:
                return np.array(chosen)
    raise InputError(f"no room for {count} starts or goals {SPACING} apart on this map")


def random_scheme(floor: FloorMap, count: int, rng: np.random.Generator) -> tuple[Points, Points]:
    """Random starts and goals, each as `random_points`."""
    starts = random_points(floor, count, rng)
    return starts, random_points(floor, count, rng, starts)
