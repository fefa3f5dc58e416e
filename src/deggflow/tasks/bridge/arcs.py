"""Times within an action at which a margin can be least; only the poses at these times are evaluated.

Under a constant body twist every point of the plank moves along a circle or a straight line. Each of its coordinates is
monotone until the point's velocity is perpendicular to that axis, and these times are known exactly. Between two such times, every margin
is a monotone function of time, and thus least at one end, unless a side of the plank passes an axis or a point passes the
middle of the gap.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .world import DT, GAP_LEFT, GAP_RIGHT

MIDDLE = (GAP_LEFT + GAP_RIGHT) / 2  # m, as far from either ground
_HALVINGS = 60  # of an action, down to less than the resolution of float64
_QUARTER = np.pi / 2
_STILL = 1e-12  # rad/s below which rotations are not resolved by float64

Poses = Float[np.ndarray, "... 3"]


class Motions(NamedTuple):
    """What actions do.

    Attributes:
        poses: At which the actions begin.
        twists: Of the actions, constant for `DT` seconds.
    """

    poses: Float[np.ndarray, "actions 3"]
    twists: Float[np.ndarray, "actions 3"]


def moved(pose: Poses, twist: Poses, seconds: float | Float[np.ndarray, "..."]) -> Poses:
    """Poses after a constant body twist, by the exact motion along a circle."""
    time = np.asarray(seconds)[..., None]
    v, turn = twist[..., :2] * time, twist[..., 2] * time[..., 0]
    straight = np.abs(turn) < 1e-12
    angle = np.where(straight, 1.0, turn)
    a = np.where(straight, 1.0, np.sin(angle) / angle)
    b = np.where(straight, 0.0, 2 * np.sin(angle / 2) ** 2 / angle)
    dx, dy = a * v[..., 0] - b * v[..., 1], b * v[..., 0] + a * v[..., 1]
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack(
        [
            pose[..., 0] + cos * dx - sin * dy,
            pose[..., 1] + sin * dx + cos * dy,
            pose[..., 2] + turn,
        ],
        -1,
    )


def turning_times(
    motions: Motions, points: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "actions times"]:
    """Times (s) at which a point's velocity, or a side of the plank, is parallel to an axis of the world; `DT` where that is later.

    Args:
        motions: Of the plank.
        points: In the plank's frame, m.
    """
    poses, twists = motions
    omega = twists[:, 2:]
    vx = twists[:, :1] - omega * points[:, 1]
    vy = twists[:, 1:2] + omega * points[:, 0]
    heading = np.concatenate([np.zeros_like(omega), np.arctan2(vy, vx)], axis=1) + poses[:, 2:]
    first = np.mod(-np.sign(omega) * heading, _QUARTER)  # rad to the next axis
    # After four axes the point repeats its circle.
    ahead = first[..., None] + _QUARTER * np.arange(4)
    rate = np.abs(omega)[..., None]
    times = ahead / np.where(rate < _STILL, np.nan, rate)
    return np.where((times > 0) & (times < DT), times, DT).reshape(len(poses), -1)


def in_order(
    regular: Float[np.ndarray, " parts"], others: Float[np.ndarray, "actions others"]
) -> Float[np.ndarray, "actions times"]:
    """Times of every action in ascending order: the common ones and its own, in as few columns as possible."""
    own = np.sort(others, axis=1)[:, : int(np.sum(others < DT, axis=1).max(initial=0))]
    same = np.broadcast_to(regular, (len(others), len(regular)))
    return np.sort(np.concatenate([same, own], axis=1), axis=1)


def crossing_times(
    motions: Motions,
    points: Float[np.ndarray, "points 2"],
    times: Float[np.ndarray, "actions times"],
) -> Float[np.ndarray, "actions crossings"]:
    """Times (s) at which a point passes the middle of the gap, found by bisection; the rest are `DT`.

    Args:
        motions: Of the plank.
        points: In the plank's frame, m.
        times: Between consecutive ones, starting from 0, every point's x is monotone.
    """
    poses, twists = motions
    if not _may_pass(motions, points):
        return np.zeros((len(poses), 0))
    begin = np.concatenate([np.zeros((len(times), 1)), times], axis=1)
    on_right = _beyond(moved(poses[:, None], twists[:, None], begin), points)
    action, k, point = np.nonzero(on_right[:, 1:] != on_right[:, :-1])
    out = np.full((len(poses), int(np.bincount(action, minlength=1).max(initial=0))), DT)
    low, high = begin[action, k], times[action, k]
    before = on_right[action, k, point]
    for _ in range(_HALVINGS if len(action) else 0):
        half = (low + high) / 2
        there = _beyond(moved(poses[action], twists[action], half), points)
        same = there[np.arange(len(point)), point] == before
        low, high = np.where(same, half, low), np.where(same, high, half)
    place = np.arange(len(action)) - np.searchsorted(action, action)
    out[action, place] = high
    return out


def _may_pass(motions: Motions, points: Float[np.ndarray, "points 2"]) -> bool:
    """Whether some action is fast enough to carry a point to the middle of the gap."""
    poses, twists = motions
    farthest = np.hypot(points[:, 0], points[:, 1]).max(initial=0.0)
    speed = np.hypot(twists[:, 0], twists[:, 1]) + np.abs(twists[:, 2]) * farthest
    away = np.abs(_x(poses, points) - MIDDLE).min(axis=1, initial=np.inf)
    return bool(np.any(away <= speed * DT))


def _beyond(
    poses: Float[np.ndarray, "... 3"], points: Float[np.ndarray, "points 2"]
) -> Bool[np.ndarray, "... points"]:
    """Which points are on the right of the gap's middle."""
    return np.asarray(_x(poses, points) > MIDDLE, dtype=bool)


def _x(
    poses: Float[np.ndarray, "... 3"], points: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "... points"]:
    """How far right points of the plank are, m."""
    cos, sin = np.cos(poses[..., 2:]), np.sin(poses[..., 2:])
    return poses[..., :1] + cos * points[:, 0] - sin * points[:, 1]
