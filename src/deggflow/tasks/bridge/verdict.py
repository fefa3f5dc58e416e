"""Exact geometry of a trial in float64: whether the plank bridges the gap, and the first failure.

Without buffers or smoothing. Shares nothing with the factors that guide the generation.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from . import world
from .arcs import Motions, crossing_times, in_order, moved, turning_times

SUB_POSES = 4  # poses evaluated in every action, besides those at which a margin can be least
_HALF = np.array([world.PLANK_LENGTH, world.PLANK_WIDTH]) / 2  # m
_CORNERS = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * _HALF
_CENTRE = np.zeros((1, 2))
_REGULAR = world.DT * np.arange(1, SUB_POSES + 1) / SUB_POSES  # s
_WAY = _HALF[0] - world.ROBOT_RADIUS - world.END_CLEARANCE  # m, half length of the robots' way

Poses = Float[np.ndarray, "... 3"]


class Margins(NamedTuple):
    """Distances to failure at poses (m); negative where a condition is violated."""

    plank: Float[np.ndarray, "..."]  # plank inside the workspace
    support: Float[np.ndarray, "..."]  # support on either ground, beyond what is needed
    wall: Float[np.ndarray, "... robots"]  # robot inside the workspace
    gap: Float[np.ndarray, "... robots"]  # robot off the gap

    def least(self) -> Float[np.ndarray, "..."]:
        """Smallest margin at each pose."""
        robots = np.minimum(self.wall.min(-1), self.gap.min(-1))
        return np.asarray(np.minimum(np.minimum(self.plank, self.support), robots))

    def reason(self, at: int) -> str:
        """The worst failure at one pose of a sequence."""
        return min(self._parts(at))[1]

    def nearest(self, at: int) -> str:
        """The condition closest to failure at one pose of a sequence, and its margin."""
        margin, _, place = min(self._parts(at))
        return f"{place}, {margin:.3f} m to spare"

    def _parts(self, at: int) -> list[tuple[float, str, str]]:
        walls, gaps = self.wall[at], self.gap[at]
        a, b = int(np.argmin(walls)) + 1, int(np.argmin(gaps)) + 1
        return [
            (float(self.plank[at]), "the plank leaves the workspace", "the plank to the wall"),
            (float(self.support[at]), "the plank loses its support", "the plank's support"),
            (float(walls.min()), f"robot {a} leaves the workspace", f"robot {a} to the wall"),
            (float(gaps.min()), f"robot {b} enters the gap", f"robot {b} to the gap"),
        ]


def _rotated(
    theta: Float[np.ndarray, "..."], points: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "... points 2"]:
    cos, sin = np.cos(theta)[..., None], np.sin(theta)[..., None]
    return np.stack(
        [cos * points[:, 0] - sin * points[:, 1], sin * points[:, 0] + cos * points[:, 1]], -1
    )


def robot_centres(contacts: Sequence[Sequence[float]]) -> Float[np.ndarray, "robots 2"]:
    """Robots' centres in the plank's frame (m)."""
    r = np.asarray(contacts, np.float64).reshape(-1, 2)
    return np.stack([r[:, 0], np.copysign(world.CENTRE_SIDE, r[:, 1])], -1)


def corners(poses: Poses) -> Float[np.ndarray, "... 4 2"]:
    """The plank's corners (m) at each pose."""
    return np.asarray(poses[..., None, :2] + _rotated(poses[..., 2], _CORNERS))


def robot_places(
    poses: Poses, contacts: Sequence[Sequence[float]]
) -> Float[np.ndarray, "... robots 2"]:
    """Robots' centres (m) at each pose of the plank."""
    return np.asarray(poses[..., None, :2] + _rotated(poses[..., 2], robot_centres(contacts)))


def margins(poses: Poses, contacts: Sequence[Sequence[float]]) -> Margins:
    """Distances to every kind of failure, at each pose."""
    plank_corners = corners(poses)
    low, high = plank_corners.min(-2), plank_corners.max(-2)
    robots = robot_places(poses, contacts)
    x, y = robots[..., 0], robots[..., 1]
    inside = np.minimum(
        np.minimum(x - world.X_MIN, world.X_MAX - x), np.minimum(y - world.Y_MIN, world.Y_MAX - y)
    )
    plank = np.minimum(low - [world.X_MIN, world.Y_MIN], [world.X_MAX, world.Y_MAX] - high).min(-1)
    support = (
        np.maximum(world.GAP_LEFT - low[..., 0], high[..., 0] - world.GAP_RIGHT) - world.SUPPORT
    )
    off_gap = np.maximum(world.GAP_LEFT - x, x - world.GAP_RIGHT) - world.ROBOT_RADIUS
    return Margins(plank, support, inside - world.ROBOT_RADIUS, off_gap)


def bridges(poses: Poses) -> Bool[np.ndarray, "..."]:
    """Whether the plank bridges the gap: it is supported on both sides, and the robots' path reaches beyond both edges."""
    along = _rotated(poses[..., 2], _CORNERS)[..., 0]
    low, high = poses[..., 0] + along.min(-1), poses[..., 0] + along.max(-1)
    way = _WAY * np.abs(np.cos(poses[..., 2]))
    supported = (low <= world.GAP_LEFT - world.SUPPORT) & (high >= world.GAP_RIGHT + world.SUPPORT)
    passable = (poses[..., 0] - way <= world.GAP_LEFT - world.CORRIDOR) & (
        poses[..., 0] + way >= world.GAP_RIGHT + world.CORRIDOR
    )
    return np.asarray(supported & passable)


def move(pose: Poses, twist: Poses, seconds: float = world.DT) -> Poses:
    """Poses after a constant body twist, by the exact motion along a circle."""
    return moved(pose, twist, seconds)


def sub_poses(
    pose: Poses, twist: Poses, parts: int = SUB_POSES
) -> Float[np.ndarray, "... parts 3"]:
    """Poses within an action, its end included."""
    return np.stack([move(pose, twist, world.DT * k / parts) for k in range(1, parts + 1)], -2)


def contact_speeds(
    twists: Float[np.ndarray, "... actions 3"], contacts: Float[np.ndarray, "... robots 2"]
) -> Float[np.ndarray, "... robots"]:
    """Largest speed of each contact point over some actions, m/s."""
    turn, r = twists[..., None, 2], contacts[..., None, :, :]
    x = twists[..., None, 0] - turn * r[..., 1]
    y = twists[..., None, 1] + turn * r[..., 0]
    return np.asarray(np.hypot(x, y).max(axis=-2, initial=0.0))


class Passage(NamedTuple):
    """Least margin and first failure within an action, its end included."""

    margin: float  # least distance to failure, m
    reason: str | None  # the first failure


def decisive_times(
    poses: Float[np.ndarray, "actions 3"],
    twists: Float[np.ndarray, "actions 3"],
    contacts: Sequence[Sequence[float]],
) -> Float[np.ndarray, "actions times"]:
    """Times (s) within every action at which a margin can be least, its end included (`arcs`)."""
    motions, robots = Motions(poses, twists), robot_centres(contacts)
    times = in_order(_REGULAR, turning_times(motions, np.concatenate([_CORNERS, robots])))
    # Where the plank's centre or a robot passes the middle of the gap, the nearer side changes.
    passing = crossing_times(motions, np.concatenate([_CENTRE, robots]), times)
    if passing.size:
        times = in_order(_REGULAR, np.concatenate([times, passing], axis=1))
    return times


def on_the_way(
    poses: Float[np.ndarray, "actions 3"],
    twists: Float[np.ndarray, "actions 3"],
    contacts: Sequence[Sequence[float]],
) -> list[Passage]:
    """Each action from its initial pose, by the least margins along its whole arc."""
    if not len(poses):
        return []
    times = decisive_times(poses, twists, contacts)
    distances = margins(moved(poses[:, None], twists[:, None], times), contacts)
    out = []
    for k, room in enumerate(distances.least()):
        broken = room < 0
        reason = None
        if broken.any():
            reason = Margins(*(leaf[k] for leaf in distances)).reason(int(np.argmax(broken)))
        out.append(Passage(float(room.min()), reason))
    return out


class Verdict(NamedTuple):
    """The outcome of a sequence of actions."""

    poses: Float[np.ndarray, "poses 3"]  # the initial one, then one per action up to the end
    bridged: bool
    reason: str | None  # the first failure, if there was one
    margin: float  # least distance to failure over everything executed, m

    @property
    def actions(self) -> int:
        """Actions executed until the trial ended or the sequence was over."""
        return len(self.poses) - 1


def integrate(
    pose: Float[np.ndarray, " 3"], twists: Float[np.ndarray, "actions 3"]
) -> Float[np.ndarray, "poses 3"]:
    """The initial pose and the pose after each action."""
    start = np.asarray(pose, np.float64)
    theta = start[2] + world.DT * np.concatenate([[0.0], np.cumsum(twists[:, 2])])
    zero = np.zeros((len(twists), 2))
    steps = move(np.concatenate([zero, theta[:-1, None]], -1), twists)[:, :2]
    place = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.concatenate([place, theta[:, None]], -1)


def execute(
    pose: Float[np.ndarray, " 3"],
    twists: Float[np.ndarray, "actions 3"],
    contacts: Sequence[Sequence[float]],
) -> Verdict:
    """Executes actions until the plank bridges the gap, something fails, or none is left."""
    twists = np.asarray(twists, np.float64).reshape(-1, 3)
    poses = integrate(pose, twists)
    passages = on_the_way(poses[:-1], twists, contacts)
    failing = np.array([each.reason is not None for each in passages], bool)
    bridged = np.asarray(bridges(poses[1:]))
    ends = np.flatnonzero(failing | bridged)
    actions = int(ends[0]) + 1 if len(ends) else len(twists)
    start = float(margins(poses[0], contacts).least())
    least = min([start, *(each.margin for each in passages[:actions])])
    if not len(ends):
        return Verdict(poses, False, None, least)
    reason = passages[actions - 1].reason
    return Verdict(poses[: actions + 1], reason is None, reason, least)
