"""An independent check of trials: replayed by matrix exponential series and judged by Shapely, from the file alone.

Between two poses, a point's coordinate, whose second derivative is at most |omega| |v|, stays within h^2 |omega| |v| / 8 of
linear interpolation. Where a failure is possible within this distance, the interval is halved until it is excluded.

Shares only the dimensions in `world` with the rest of the package.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from shapely.geometry import box

from . import world

PARTS = (
    8  # poses looked at in every action, besides those between that are looked at where it is close
)
TOLERANCE = 1e-8  # m, rounding of float64 arithmetic
_FINER = 16  # times as many, where depths are measured
TERMS = 40  # of the exponential series
SAGITTA = 1e-3  # m, tolerance of least margins, which are taken at different poses
FLOOR = 1e-9  # m; intervals in which margins vary by less are not halved, as this is below rounding

_FAR = 1e3  # m, beyond everything
# m, no point that counts is farther out
_REACH = float(np.hypot(world.PLANK_LENGTH / 2, world.CENTRE_SIDE))
_WORKSPACE = box(world.X_MIN, world.Y_MIN, world.X_MAX, world.Y_MAX)
_OFF_LEFT = box(world.GAP_LEFT, -_FAR, _FAR, _FAR)
_OFF_RIGHT = box(-_FAR, -_FAR, world.GAP_RIGHT, _FAR)
_LEFT = box(-_FAR, -_FAR, world.GAP_LEFT, _FAR)
_RIGHT = box(world.GAP_RIGHT, -_FAR, _FAR, _FAR)
_HALF_WAY = world.PLANK_LENGTH / 2 - world.ROBOT_RADIUS - world.END_CLEARANCE  # m
_BLAMED = re.compile(
    "(?P<start>at the start )?"
    "(the plank (?P<plank>leaves the workspace|loses its support)|"
    "robot (?P<robot>[0-9]{1,3}) (?P<how>leaves the workspace|enters the gap))"
)

Moves = Float[np.ndarray, "moves 3 3"]


class Motion(NamedTuple):
    """Margins (m) at every pose of a replay."""

    plank: Float[np.ndarray, " poses"]  # inside the workspace
    support: Float[
        np.ndarray, "poses 2"
    ]  # on the left and on the right ground, beyond what is needed
    way: Float[np.ndarray, "poses 2"]  # of the robots' way beyond the left and the right edge
    wall: Float[np.ndarray, "poses robots"]  # robots inside the workspace
    off: Float[np.ndarray, "poses robots 2"]  # robots on the left and on the right of the gap

    @property
    def gap(self) -> Float[np.ndarray, "poses robots"]:
        """Robots off the gap, on either ground."""
        return np.asarray(self.off.max(-1))

    @property
    def least(self) -> Float[np.ndarray, " poses"]:
        """Smallest distance to failure; once a robot or the plank is outside, only its sign is meaningful."""
        robots = np.minimum(self.wall.min(-1), self.gap.min(-1))
        return np.minimum(np.minimum(self.plank, self.support.max(-1)), robots)

    def bridges(self, spare: float) -> Bool[np.ndarray, " poses"]:
        """Whether the plank bridges the gap, with so much to spare."""
        return np.minimum(self.support.min(-1), self.way.min(-1)) >= spare

    def at(self, index: Int[np.ndarray, " some"]) -> "Motion":
        """Margins at some of the poses."""
        return Motion(*(leaf[index] for leaf in self))

    def either(self) -> Float[np.ndarray, "poses margins 2"]:
        """All conditions of safety; of each pair (left or right of the gap), one has to hold."""
        same = np.column_stack([self.plank, self.wall])
        both = np.repeat(same[..., None], 2, axis=-1)
        return np.concatenate([both, self.support[:, None], self.off], axis=1)


def _placed(moves: Moves, points: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """Points of the plank, as every move leaves them."""
    homogeneous = np.column_stack([points, np.ones(len(points))])
    return np.einsum("mij,pj->mpi", moves, homogeneous)[..., :2]


def _generators(twists: Float[np.ndarray, "actions 3"]) -> Moves:
    out = np.zeros((len(twists), 3, 3))
    out[:, 0, 1], out[:, 1, 0] = -twists[:, 2], twists[:, 2]
    out[:, :2, 2] = twists[:, :2]
    return out


def _exponential(matrices: Moves) -> Moves:
    """The exponential by its series, exact to rounding for entries up to 5 (100 m/s for an eighth of an action: 2.5)."""
    term = out = np.broadcast_to(np.eye(3), matrices.shape)
    for k in range(1, TERMS):
        term = np.einsum("mij,mjk->mik", term, matrices) / k
        out = out + term
    return out


def replay(value: Mapping[str, Any]) -> Moves:
    """Homogeneous matrices of the plank's pose: the initial one, then `PARTS` of every action.

    Args:
        value: A trial as it stands in a file; its poses are not read.
    """
    start = value["condition"]["plank"]
    x, y, cos, sin = start["x"], start["y"], np.cos(start["theta"]), np.sin(start["theta"])
    moves = [np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])]
    twists = np.array(value["twists"], np.float64).reshape(-1, 3)
    for step in _exponential(_generators(twists) * (value["dt"] / PARTS)):
        for _ in range(PARTS):
            moves.append(moves[-1] @ step)
    return np.array(moves)


def _inside(shapes: np.ndarray) -> np.ndarray:
    """Distance to the workspace's border; negative for shapes that are not entirely inside."""
    away = shapely.distance(shapes, _WORKSPACE.exterior)
    return np.where(shapely.covers(_WORKSPACE, shapes), away, np.minimum(-away, -2 * TOLERANCE))


def judge(value: Mapping[str, Any], moves: Moves) -> Motion:
    """Margins of a replay."""
    half = np.array([world.PLANK_LENGTH, world.PLANK_WIDTH]) / 2
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    planks = shapely.polygons(_placed(moves, corners))
    ways = shapely.linestrings(_placed(moves, np.array([[-_HALF_WAY, 0.0], [_HALF_WAY, 0.0]])))
    contacts = np.array(value["condition"]["contacts"], np.float64)
    centres = np.column_stack([contacts[:, 0], world.CENTRE_SIDE * np.sign(contacts[:, 1])])
    robots = shapely.points(_placed(moves, centres))
    on_left = shapely.bounds(shapely.intersection(planks, _LEFT))[:, 0]
    on_right = shapely.bounds(shapely.intersection(planks, _RIGHT))[:, 2]
    reach = shapely.bounds(ways)
    support = (
        np.column_stack([world.GAP_LEFT - on_left, on_right - world.GAP_RIGHT]) - world.SUPPORT
    )
    return Motion(
        _inside(planks),
        np.where(np.isnan(support), -_FAR, support),  # no part of the plank is on that ground
        np.column_stack([world.GAP_LEFT - reach[:, 0], reach[:, 2] - world.GAP_RIGHT])
        - world.CORRIDOR,
        _inside(robots) - world.ROBOT_RADIUS,
        np.stack([shapely.distance(robots, off) for off in (_OFF_LEFT, _OFF_RIGHT)], -1)
        - world.ROBOT_RADIUS,
    )


class RefinedReplay(NamedTuple):
    """A replay in order of time, refined where a failure between two poses is possible."""

    motion: Motion
    action: Int[np.ndarray, " poses"]  # that leads to the pose, from 1; 0: the initial pose

    @property
    def ends(self) -> Int[np.ndarray, " ends"]:
        """Which poses are the initial one and the last of every action."""
        return np.flatnonzero(np.diff(self.action, append=self.action[-1] + 1))


class _Between(NamedTuple):
    """Intervals between two poses: the part, begin and end after its start (s), and the margins at both."""

    part: Int[np.ndarray, " times"]
    begin: Float[np.ndarray, " times"]
    end: Float[np.ndarray, " times"]
    before: Motion
    after: Motion


def _may_fail(times: _Between, dip: Float[np.ndarray, " times"]) -> Bool[np.ndarray, " times"]:
    """Intervals in which a condition that holds at both ends, on the same side of the gap, may fail."""
    before, after = times.before.either(), times.after.either()
    holds = np.minimum(before.max(-1), after.max(-1)) >= -TOLERANCE
    low = np.minimum(before, after).max(-1) - dip[:, None]
    return np.asarray((holds & (low < -FLOOR)).any(-1))


def refine_replay(value: Mapping[str, Any], moves: Moves) -> RefinedReplay:
    """Margins of a replay at its poses and at all times where a failure is possible.

    Args:
        value: A trial as it stands in a file.
        moves: Of `replay`.
    """
    twists = np.repeat(np.array(value["twists"], np.float64).reshape(-1, 3), PARTS, axis=0)
    lines, turn = _generators(twists), np.abs(twists[:, 2])
    speed = np.hypot(twists[:, 0], twists[:, 1]) + turn * _REACH
    parts, whole = np.arange(len(twists)), judge(value, moves)
    step = value["dt"] / PARTS
    times = _Between(parts, 0.0 * parts, 0.0 * parts + step, whole.at(parts), whole.at(parts + 1))
    samples = [(np.array([-PARTS, *parts]), np.array([step, *times.end]), whole)]
    while len(times.part):
        width = times.end - times.begin
        dip = width**2 * (turn * speed)[times.part] / 8
        unsure = _may_fail(times, dip) & (dip + width * speed[times.part] > FLOOR)
        part, begin, end = (leaf[unsure] for leaf in times[:3])
        half = (begin + end) / 2
        there = moves[part] @ _exponential(lines[part] * half[:, None, None])
        motion = judge(value, there)
        samples.append((part, half, motion))
        before, after = (leaf.at(np.flatnonzero(unsure)) for leaf in times[3:])
        times = _Between(
            np.concatenate([part, part]),
            np.concatenate([begin, half]),
            np.concatenate([half, end]),
            _joined([before, motion]),
            _joined([motion, after]),
        )
    part, when = (np.concatenate(each) for each in tuple(zip(*samples, strict=True))[:2])
    order = np.lexsort((when, part))
    motion = _joined([each[2] for each in samples]).at(order)
    return RefinedReplay(motion, part[order] // PARTS + 1)


def _joined(motions: Sequence[Motion]) -> Motion:
    return Motion(*(np.concatenate(leaves) for leaves in zip(*motions, strict=True)))


def least_margin(value: Mapping[str, Any]) -> tuple[float, float]:
    """Least distance to a failure over all executed actions, negative by the depth of a failure, and its error bound (m).

    Computed from corners and centres at 128 poses of every action, not from shapes, which have no depth.

    Args:
        value: A trial as it stands in a file.
    """
    moves = replay(value)
    twists = np.repeat(np.array(value["twists"], np.float64).reshape(-1, 3), PARTS, axis=0)
    step = value["dt"] / PARTS
    finer = _exponential(_generators(np.repeat(twists, _FINER, axis=0)) * (step / _FINER))
    for k in range(1, _FINER):
        part = finer[k::_FINER]
        part[:] = part @ finer[k - 1 :: _FINER]
    every = np.repeat(moves[:-1], _FINER, axis=0) @ finer
    speed = np.hypot(twists[:, 0], twists[:, 1]) + np.abs(twists[:, 2]) * _REACH
    least = _depth(value, np.concatenate([moves[:1], every]))
    return least, float(speed.max(initial=0.0)) * step / _FINER / 2


def _depth(value: Mapping[str, Any], moves: Moves) -> float:
    half = np.array([world.PLANK_LENGTH, world.PLANK_WIDTH]) / 2
    corners = _placed(moves, np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half)
    contacts = np.array(value["condition"]["contacts"], np.float64)
    centres = np.column_stack([contacts[:, 0], world.CENTRE_SIDE * np.sign(contacts[:, 1])])
    robots = _placed(moves, centres)
    low, high = np.array([world.X_MIN, world.Y_MIN]), np.array([world.X_MAX, world.Y_MAX])
    support = np.maximum(
        world.GAP_LEFT - corners[..., 0].min(-1), corners[..., 0].max(-1) - world.GAP_RIGHT
    )
    off = np.maximum(world.GAP_LEFT - robots[..., 0], robots[..., 0] - world.GAP_RIGHT)
    clearances = (
        *(corners - low, high - corners, support - world.SUPPORT),
        *(
            robots - low - world.ROBOT_RADIUS,
            high - robots - world.ROBOT_RADIUS,
            off - world.ROBOT_RADIUS,
        ),
    )
    return float(min(each.min() for each in clearances))


def _poses_differ(value: Mapping[str, Any], moves: Moves) -> str | None:
    poses = np.array(value["poses"], np.float64).reshape(-1, 3)
    replayed = moves[::PARTS]
    if len(poses) != len(replayed):
        return f"there are {len(poses)} poses for {len(replayed) - 1} actions"
    direction = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], -1)
    away = np.abs(
        np.concatenate([replayed[:, :2, 2] - poses[:, :2], replayed[:, :2, 0] - direction], 1)
    )
    wrong = ~(away.max(-1) <= TOLERANCE)
    return f"pose {np.argmax(wrong)} is not where the twists lead" if wrong.any() else None


def _goes_on(observation: RefinedReplay) -> str | None:
    """The event that should have ended the trial before its last action, if any."""
    motion, ends = observation.motion, observation.ends[:-1]
    for what, over in (
        ("the gap is bridged", motion.bridges(TOLERANCE)[ends]),
        ("something fails", np.logical_or.accumulate(motion.least < -TOLERANCE)[ends]),
    ):
        if over.any():
            return f"the trial goes on after action {np.argmax(over)}, where {what}"
    return None


def _blamed(observation: RefinedReplay, reason: str) -> str | None:
    """How the stated reason for a failure is wrong, if it is."""
    blame, motion = _BLAMED.fullmatch(reason), observation.motion
    worst = motion.least.min()
    if blame is None:
        return "something fails that is not told" if worst < -TOLERANCE else None
    last = observation.action == (0 if blame["start"] else observation.action[-1])
    if blame["plank"]:
        clearance = motion.plank if blame["plank"].startswith("leaves") else motion.support.max(-1)
    else:
        robots = motion.wall if blame["how"].startswith("leaves") else motion.gap
        if not 1 <= int(blame["robot"]) <= robots.shape[1]:
            return f"there is no robot {blame['robot']}"
        clearance = robots[:, int(blame["robot"]) - 1]
    return f"it is not so that {reason}" if clearance[last].min() > TOLERANCE else None


def fastest_contact(value: Mapping[str, Any]) -> float:
    """Largest speed of a contact point in a trial: of v + omega x r, in m/s."""
    pairs = product(value["twists"], value["condition"]["contacts"])
    return max((abs(complex(x, y) + 1j * w * complex(*r)) for (x, y, w), r in pairs), default=0.0)


def _certificate(value: Mapping[str, Any], motion: Motion) -> str | None:
    certificate = value["certificate"]
    broken = [p for p in certificate["policies"] if p["q_task"] > p["bound"] or p["q_safe"] > 0]
    if not certificate["satisfied"]:
        return None
    if not value["outcome"]["success"]:
        return "a trial that failed is certified"
    if broken or not all(p["accepted"] for p in certificate["policies"]):
        return "a policy that misses a bound is certified"
    limit = certificate.get("speed_limit")
    if limit is not None and fastest_contact(value) > limit + TOLERANCE:
        return f"a contact point moves at {fastest_contact(value):.4f} m/s"
    if abs(motion.least.min() - certificate["min_margin"]) > SAGITTA:
        return f"the least margin is {motion.least.min():.4f} m"
    return None


def refutation(value: Mapping[str, Any]) -> str | None:
    """The first claim of a trial that is false, or None.

    Args:
        value: A trial as it stands in a file.
    """
    moves = replay(value)
    wrong = _poses_differ(value, moves)
    if wrong is not None:
        return wrong
    observation = refine_replay(value, moves)
    motion = observation.motion
    wrong = _goes_on(observation)
    if wrong is not None:
        return wrong
    success_possible = bool(motion.bridges(-TOLERANCE)[-1] and motion.least.min() >= -TOLERANCE)
    success_certain = bool(motion.bridges(TOLERANCE)[-1] and motion.least.min() >= TOLERANCE)
    success, reason = value["outcome"]["success"], value["outcome"]["reason"]
    if success and not success_possible:
        return "the plank does not bridge the gap unharmed"
    if not success and success_certain:
        return "the plank bridges the gap unharmed"
    wrong = None if success else _blamed(observation, reason)
    return _certificate(value, motion) if wrong is None else wrong
