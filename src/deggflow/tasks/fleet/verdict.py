"""The verdict on plans, in closed form for straight motion between waypoints, in float64.

Shares no code with guidance, and nothing with the oracle.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from deggflow.blocks import map_groups

from .condition import APART, FleetCondition
from .maps import FloorMap
from .segments import norm, point_from_segment, segment_from_ring

MARGINS_AT_ONCE = 100_000  # pairs of steps with obstacles or other robots; more at once no longer fit a core's cache
PAIRS = 1_000_000  # of polygons and steps of one plan, looked at at once

Paths = Float[np.ndarray, "_robots 64 2"]  # plans of one call differ in their numbers
Teams = Float[np.ndarray, "plans robots 64 2"]
Index = Int[np.ndarray, "#plans margins"]


@dataclass(frozen=True)
class Miss:
    """The least margin of a kind of requirement.

    Attributes:
        kind: "ends", "apart", "inside", "outside" or "speed".
        margin: In map units; negative where the requirement is violated.
        robot: Whose it is, from 0.
        other: The other robot of a pair, or the obstacle, from 0; None where there is neither.
        step: The waypoint before the motion in which it is.
    """

    kind: str
    margin: float
    robot: int
    other: int | None
    step: int

    def text(self) -> str:
        """Which robot misses what, where and by how much; robots, obstacles and waypoints count from 1."""
        where = f"between waypoints {self.step + 1} and {self.step + 2}"
        whom = {
            "ends": "its start and goal",
            "apart": f"the distance to robot {(self.other or 0) + 1}",
            "inside": "the bounds",
            "outside": f"obstacle {(self.other or 0) + 1}",
            "speed": "the speed limit",
        }[self.kind]
        return f"robot {self.robot + 1} misses {self.kind} ({whom}, {where}) by {-self.margin:.6g}"


@dataclass(frozen=True)
class Verdict:
    """What holds of a plan.

    Attributes:
        misses: The least margin of every kind.
        violation: Half the sum of all squared shortfalls from zero, in squared map units; zero if and only if all holds.
        blocked: Robots that miss anything, pairs with both.
    """

    misses: tuple[Miss, ...]
    violation: float
    blocked: tuple[int, ...]

    @property
    def worst(self) -> Miss:
        """The least margin of all."""
        return min(self.misses, key=lambda miss: miss.margin)

    @property
    def min_margin(self) -> float:
        """In map units."""
        return self.worst.margin

    @property
    def satisfied(self) -> bool:
        """Whether every requirement holds."""
        return self.min_margin >= 0

    def reason(self) -> str | None:
        """The worst miss, and all robots that are blocked; None if every requirement holds."""
        if self.satisfied:
            return None
        names = [str(robot + 1) for robot in self.blocked]
        more = "" if len(names) < 2 else f"; blocked: robots {', '.join(names)}"
        return self.worst.text() + more


class _Margins(NamedTuple):
    """Margins of one kind, with robot, other and step of each; pairs are missed by both robots."""

    kind: str
    margin: Float[np.ndarray, "plans margins"]
    robot: Index
    other: Index | None
    step: Index


def obstacle_rings(floor: FloorMap) -> list[Float[np.ndarray, "_corners 2"]]:
    """Corners of boxes and polygons."""
    rings = []
    for x, y, w, h in floor.boxes:
        rings.append(
            np.array([(x - w / 2, y - h / 2), (x + w / 2, y - h / 2), (x + w / 2, y + h / 2), (x - w / 2, y + h / 2)])
        )  # fmt: skip
    return rings + [np.array(corners) for corners in floor.polygons]


def _outside(condition: FleetCondition, paths: Teams) -> Iterator[_Margins]:
    """Of every obstacle, numbered with boxes first, then polygons, then discs."""
    floor, plans = condition.floor, len(paths)
    first, last = (part.reshape(plans, -1, 2) for part in (paths[:, :, :-1], paths[:, :, 1:]))
    robot, step = np.divmod(np.arange(first.shape[1]), paths.shape[2] - 1)
    rings = obstacle_rings(floor)
    for numbers in _ring_groups(rings, first.shape[1]):
        group = np.array([rings[k] for k in numbers])
        plan, ring, part, distance = _nearest_steps(first, last, group, condition.radius)
        columns = (distance - condition.radius, robot[part], numbers[ring], step[part])
        yield _Margins("outside", *_by_plan(plan, plans, columns))
    if floor.discs:
        discs = np.array(floor.discs)
        near = point_from_segment(discs[:, None, :2], first[:, None], last[:, None])
        margin = (near - discs[:, 2:] - condition.radius).reshape(plans, -1)
        count = len(discs)
        number = np.repeat(np.arange(len(rings), len(rings) + count), len(robot))
        yield _Margins(
            "outside", margin, np.tile(robot, count)[None], number[None], np.tile(step, count)[None]
        )


def _by_plan(
    plan: Int[np.ndarray, " values"],
    plans: int,
    columns: tuple[Float[np.ndarray, " values"] | Int[np.ndarray, " values"], ...],
) -> Iterator[np.ndarray]:
    """Values with a row for each plan; what a row lacks is infinite in the first column.

    Args:
        plan: Whose each value is, in ascending order.
        plans: How many there are.
        columns: The values; the first ones are margins.
    """
    count = np.bincount(plan, minlength=plans)
    place = np.arange(len(plan)) - np.repeat(np.cumsum(count) - count, count)
    for k, column in enumerate(columns):
        rows = np.full((plans, count.max()), 0 if k else np.inf, column.dtype)
        rows[plan, place] = column
        yield rows


def _ring_groups(
    rings: Sequence[Float[np.ndarray, "_ 2"]], steps: int
) -> Iterator[Int[np.ndarray, " _"]]:
    """Numbers of polygons with equally many corners, not too many at once."""
    corners = np.array([len(ring) for ring in rings], int)
    for count in np.unique(corners):
        numbers = np.flatnonzero(corners == count)
        yield from np.array_split(numbers, -(-len(numbers) * steps // PAIRS))


def _nearest_steps(
    first: Float[np.ndarray, "plans steps 2"],
    last: Float[np.ndarray, "plans steps 2"],
    rings: Float[np.ndarray, "rings corners 2"],
    reach: float,
) -> tuple[
    Int[np.ndarray, " pairs"],
    Int[np.ndarray, " pairs"],
    Int[np.ndarray, " pairs"],
    Float[np.ndarray, " pairs"],
]:
    """Plans, polygons, segments and distances, of all pairs that are within reach or can be a plan's nearest of a polygon."""
    half, middle = norm(last - first)[:, None] / 2, ((first + last) / 2)[:, None]
    low, high = rings.min(1)[:, None], rings.max(1)[:, None]
    # A lower bound, by the box around the polygon, and one upper bound of the least distance.
    bound = norm(np.maximum(np.maximum(low - middle, middle - high), 0.0)) - half
    plan, ring = (index.ravel() for index in np.indices(bound.shape[:2]))
    bound -= 1e-9 * (
        np.abs(middle).max() + np.abs(rings).max()
    )  # of rounding, far below what it may be
    nearest = bound.argmin(-1).ravel()
    least = segment_from_ring(first[plan, nearest], last[plan, nearest], rings[ring])
    limit = np.maximum(least, reach).reshape(bound.shape[:2])
    plan, ring, part = np.nonzero(bound <= limit[..., None])
    return (
        plan, ring, part, segment_from_ring(first[plan, part], last[plan, part], rings[ring])
    )  # fmt: skip


def _margins(conditions: Sequence[FleetCondition], paths: Teams) -> Iterator[_Margins]:
    """Of plans with equally many robots on one floor, with the same radius and speed limit."""
    condition = conditions[0]
    plans, robots, waypoints, _ = paths.shape
    robot, step = np.divmod(np.arange(robots * (waypoints - 1))[None], waypoints - 1)
    starts = np.array([each.starts for each in conditions])
    goals = np.array([each.goals for each in conditions])
    away = np.stack([norm(paths[:, :, 0] - starts), norm(paths[:, :, -1] - goals)], axis=2)
    ends = np.where(away == 0, np.inf, -away).reshape(plans, -1)
    places = np.tile([0, waypoints - 2], robots)[None]
    yield _Margins("ends", ends, np.repeat(np.arange(robots), 2)[None], None, places)
    first, second = np.triu_indices(robots, 1)
    if len(first):
        offset = paths[:, first] - paths[:, second]
        near = point_from_segment(np.zeros(2), offset[:, :, :-1], offset[:, :, 1:])
        margin = (near - APART * condition.radius).reshape(plans, -1)
        pair, at = np.divmod(np.arange(margin.shape[1])[None], waypoints - 1)
        yield _Margins("apart", margin, first[pair], second[pair], at)
    low, high = np.reshape(condition.floor.bounds, (2, 2))
    room = np.minimum(paths - low, high - paths)
    room = np.minimum(room[..., 0], room[..., 1]) - condition.radius
    margin = np.minimum(room[..., :-1], room[..., 1:]).reshape(plans, -1)
    yield _Margins("inside", margin, robot, None, step)
    if condition.floor.obstacles:
        yield _joined(list(_outside(condition, paths)))
    speed = condition.speed_limit - norm(np.diff(paths, axis=2))
    yield _Margins("speed", speed.reshape(plans, -1), robot, None, step)


def _joined(parts: Sequence[_Margins]) -> _Margins:
    """Margins of one kind as one."""
    if len(parts) == 1:
        return parts[0]
    plans = len(parts[0].margin)
    columns = [
        np.concatenate([np.broadcast_to(each, (plans, each.shape[1])) for each in column], axis=1)
        for column in list(zip(*parts, strict=True))[1:]
    ]
    return _Margins(parts[0].kind, *columns)


def _verdicts(conditions: Sequence[FleetCondition], paths: Teams) -> list[Verdict]:
    """Of plans as of `_margins`."""
    plans = len(paths)
    misses: list[list[Miss]] = [[] for _ in range(plans)]
    violation, blocked = [0.0] * plans, [set[int]() for _ in range(plans)]
    # What touches, in numbers that floating point can't represent, holds.
    rounding = 8 * np.finfo(float).eps * np.abs(conditions[0].floor.bounds).max()
    for kind in _margins(conditions, paths):
        margin = np.where(np.isnan(kind.margin), -np.inf, kind.margin)
        if kind.kind != "ends":
            margin = np.where(np.abs(margin) <= rounding, 0.0, margin)
        index = [
            None if each is None else np.broadcast_to(each, margin.shape)
            for each in (kind.robot, kind.other, kind.step)
        ]
        worst = margin.argmin(1)
        for k, place in enumerate(worst.tolist()):
            robot, other, step = (None if each is None else int(each[k, place]) for each in index)
            assert robot is not None
            assert step is not None
            misses[k].append(Miss(kind.kind, float(margin[k, place]), robot, other, step))
        for k in np.flatnonzero(margin.min(1) < 0).tolist():
            short = margin[k] < 0
            violation[k] += float(np.sum(margin[k, short] ** 2) / 2)
            missing = index[:2] if kind.kind == "apart" else index[:1]
            for robots in missing:
                assert robots is not None
                blocked[k].update(robots[k, short].tolist())
    return [
        Verdict(tuple(kinds), total, tuple(sorted(robots)))
        for kinds, total, robots in zip(misses, violation, blocked, strict=True)
    ]


def _plan_groups(
    conditions: Sequence[FleetCondition], paths: Sequence[Paths]
) -> Iterator[list[int]]:
    """Numbers of plans as of `_margins`, not too many at once."""
    groups: dict[Hashable, list[int]] = {}
    for k, (condition, path) in enumerate(zip(conditions, paths, strict=True)):
        key = (condition.map, condition.radius, condition.speed_limit, path.shape)
        groups.setdefault(key, []).append(k)
    for group in groups.values():
        robots, waypoints, _ = paths[group[0]].shape
        others = conditions[group[0]].floor.obstacles + robots
        count = max(1, MARGINS_AT_ONCE // (robots * waypoints * others))
        yield from (group[k : k + count] for k in range(0, len(group), count))


def judge(conditions: Sequence[FleetCondition], paths: Sequence[Paths]) -> list[Verdict]:
    """The verdict on every plan; paths must be finite."""

    def of_group(group: list[int]) -> list[Verdict]:
        teams = np.array([paths[k] for k in group], float)
        return _verdicts([conditions[k] for k in group], teams)

    return map_groups(of_group, [*_plan_groups(conditions, paths)], len(conditions))
