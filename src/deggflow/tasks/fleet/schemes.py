"""Starts and goals of drawn conditions: MMD's own scheme of each named map, and random ones.

Source: yoraish/mmd (MMD, ICLR 2025) for the schemes of its four maps.
"""

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError

from .clearance import clearance
from .maps import FloorMap

OWN = ("empty", "conveyor", "highways", "drop_region")  # named maps with a scheme of their own
SPACING = 0.15  # map units, least distance of random starts, and of random goals
ROOM = 0.16  # map units, least distance of random starts and goals from obstacles
_EDGE = 0.9  # largest coordinate of random points, of the map's half width
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


def random_points(floor: FloorMap, count: int, rng: np.random.Generator) -> Points:
    """Random places at least `SPACING` apart and `ROOM` from obstacles.

    Raises:
        InputError: The floor has too little room.
    """
    low, high = np.reshape(floor.bounds, (2, 2))
    middle, half = (low + high) / 2, _EDGE * (high - low) / 2
    for _ in range(_ATTEMPTS):
        points = middle + half * rng.uniform(-1.0, 1.0, (40 * count, 2))
        points = points[clearance(floor, points) >= ROOM]
        chosen: list[Float[np.ndarray, " 2"]] = []
        for point in points:
            if all(np.hypot(*(point - other)) >= SPACING for other in chosen):
                chosen.append(point)
            if len(chosen) == count:
                return np.array(chosen)
    raise InputError(f"no room for {count} starts or goals {SPACING} apart on this map")


def random_scheme(floor: FloorMap, count: int, rng: np.random.Generator) -> tuple[Points, Points]:
    """Random starts and goals, each as `random_points`."""
    return random_points(floor, count, rng), random_points(floor, count, rng)
