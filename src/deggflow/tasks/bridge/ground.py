"""Straight moves that are free for one robot's centre: on the grounds, and over the bridge."""

from collections.abc import Callable
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from . import world

EXACT = 1e-9  # m, rounding
SPARE = 0.02  # m, distance to the plank of moves that neither begin nor end closer to it

HALF = np.array([world.PLANK_LENGTH, world.PLANK_WIDTH]) / 2  # m
# Lower and upper corners of the grounds, for centres.
_INSET = [[world.ROBOT_RADIUS], [-world.ROBOT_RADIUS]]
LEFT = np.array([[world.X_MIN, world.Y_MIN], [world.GAP_LEFT, world.Y_MAX]]) + _INSET
RIGHT = np.array([[world.GAP_RIGHT, world.Y_MIN], [world.X_MAX, world.Y_MAX]]) + _INSET

Pose = Float[np.ndarray, " 3"]
Points = Float[np.ndarray, "points 2"]
Clear = Callable[
    [Float[np.ndarray, "moves 2"], Float[np.ndarray, "moves 2"]], Bool[np.ndarray, " moves"]
]


def placed(pose: Pose, local: Points) -> Points:
    """Points of a frame at a pose, in the world."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return pose[:2] + local @ np.array([[cos, sin], [-sin, cos]])


def seen_from(pose: Pose, points: Points) -> Points:
    """Points of the world, in the frame at a pose."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def nearest_approach(
    before: Float[np.ndarray, "*shape 2"], after: Float[np.ndarray, "*shape 2"]
) -> Float[np.ndarray, "*shape"]:
    """Least length of a vector that changes at a constant rate from a to b."""
    change = after - before
    rate = np.einsum("...i,...i->...", change, change)
    toward = -np.einsum("...i,...i->...", before, change)
    when = np.clip(toward / np.where(rate > 0, rate, 1.0), 0.0, 1.0)
    least = before + when[..., None] * change
    return np.sqrt(np.einsum("...i,...i->...", least, least))


def plank_distance(pose: Pose, points: Points) -> Float[np.ndarray, " points"]:
    """Distance to the plank (m)."""
    return np.linalg.norm(np.maximum(np.abs(seen_from(pose, points)) - HALF, 0.0), axis=-1)


def _within(points: Points, box: Float[np.ndarray, "2 2"]) -> Bool[np.ndarray, " points"]:
    return np.all((points >= box[0] - EXACT) & (points <= box[1] + EXACT), axis=-1)


def _meets_box(a: Points, b: Points, half: Points) -> Bool[np.ndarray, " points"]:
    """Whether the segments from a to b meet open boxes around the origin (separating axes)."""
    middle, arm = (a + b) / 2, (b - a) / 2
    size = np.abs(arm)
    beside = np.any(np.abs(middle) >= half + size, axis=-1)
    offset = np.abs(arm[:, 0] * middle[:, 1] - arm[:, 1] * middle[:, 0])
    extent = half[:, 0] * size[:, 1] + half[:, 1] * size[:, 0]
    return ~(beside | ((offset >= extent) & (extent > 0)))


def around_plank(plank: Pose) -> Clear:
    """Straight moves on the left ground, with the plank as an obstacle."""

    def clear(start: Points, end: Points) -> Bool[np.ndarray, " points"]:
        nearer = np.minimum(plank_distance(plank, start), plank_distance(plank, end))
        free = _within(start, LEFT) & _within(end, LEFT) & (nearer >= world.ROBOT_RADIUS - EXACT)
        keep = np.minimum(nearer, world.ROBOT_RADIUS + SPARE)[:, None] - EXACT
        a, b = seen_from(plank, start), seen_from(plank, end)
        # The plank grown by `keep` is two boxes, and a disk at each corner.
        for axes in ([1.0, 0.0], [0.0, 1.0]):
            free &= ~_meets_box(a, b, HALF + keep * axes)
        for signs in product((-1.0, 1.0), repeat=2):
            free &= nearest_approach(a - HALF * signs, b - HALF * signs) >= keep[:, 0]
        return free

    return clear


def over_bridge(line: Pose, length: float) -> Clear:
    """Straight moves on either ground, or along the plank's centre line.

    Args:
        line: Where the centre line begins to be used, and its direction.
        length: How far from there it is used (m).
    """
    everywhere, along = np.array([LEFT[0], RIGHT[1]]), np.array([[0.0, 0.0], [length, 0.0]])

    def clear(start: Points, end: Points) -> Bool[np.ndarray, " points"]:
        on_line = _within(start, everywhere) & _within(end, everywhere)
        for points in (start, end):
            on_line &= _within(seen_from(line, points), along)
        left, right = (_within(start, box) & _within(end, box) for box in (LEFT, RIGHT))
        return left | right | on_line

    return clear
