"""The verdict on plans, in closed form for straight motion between waypoints, in float64.

Shares no code with guidance, and nothing with the oracle.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .condition import APART, FleetCondition
from .maps import FloorMap

PAIRS = 1_000_000  # of polygons and steps, looked at at once

Paths = Float[np.ndarray, "robots 64 2"]
Vectors = Float[np.ndarray, "... 2"]


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


def _norm(vector: Vectors) -> Float[np.ndarray, "..."]:
    # Not a sum over an axis of two, which takes several times as long.
    return np.sqrt(vector[..., 0] ** 2 + vector[..., 1] ** 2)


def _cross(a: Vectors, b: Vectors) -> Float[np.ndarray, "..."]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def point_from_segment(point: Vectors, a: Vectors, b: Vectors) -> Float[np.ndarray, "..."]:
    """Distance of points to segments."""
    way, from_a = b - a, point - a
    square = way[..., 0] ** 2 + way[..., 1] ** 2
    share = from_a[..., 0] * way[..., 0] + from_a[..., 1] * way[..., 1]
    share = np.clip(share / np.where(square > 0, square, 1.0), 0.0, 1.0)
    return _norm(from_a - share[..., None] * way)


def _crosses(a: Vectors, b: Vectors, c: Vectors, d: Vectors) -> np.ndarray:
    """Whether segments a-b and c-d cross in a point inside of both."""
    one = _cross(b - a, c - a) * _cross(b - a, d - a) < 0
    return one & (_cross(d - c, a - c) * _cross(d - c, b - c) < 0)


def segment_from_ring(
    first: Float[np.ndarray, "steps 2"],
    last: Float[np.ndarray, "steps 2"],
    ring: Float[np.ndarray, "#steps corners 2"],
) -> Float[np.ndarray, " steps"]:
    """Distance of segments to simple polygons: at most zero where they meet, by the depth of the deeper end."""
    a, b = ring, np.roll(ring, -1, axis=1)
    start, end = first[:, None], last[:, None]
    near = np.minimum(point_from_segment(start, a, b), point_from_segment(end, a, b))
    near = np.minimum(near, point_from_segment(a, start, end)).min(axis=1)
    depth = np.full(len(first), -1.0)
    for point in (first, last):
        edge = point_from_segment(point[:, None], a, b).min(axis=1)
        depth = np.maximum(depth, np.where(_contains(a, b, point), edge, -1.0))
    meets = _crosses(start, end, a, b).any(axis=1) | (depth >= 0)
    return np.where(meets, -np.maximum(depth, 0.0), near)


def _contains(a: Vectors, b: Vectors, point: Float[np.ndarray, "steps 2"]) -> np.ndarray:
    """Whether a ray to the right passes an odd number of edges a-b."""
    x, y = point[:, None, 0], point[:, None, 1]
    over = (a[..., 1] > y) != (b[..., 1] > y)
    rise = np.where(a[..., 1] == b[..., 1], 1.0, b[..., 1] - a[..., 1])
    right = x < a[..., 0] + (y - a[..., 1]) / rise * (b[..., 0] - a[..., 0])
    return ((over & right).sum(1) % 2) == 1


class _Margins(NamedTuple):
    """Margins of one kind, with robot, other and step of each; `both` for pairs, which two robots miss."""

    kind: str
    margin: Float[np.ndarray, " margins"]
    robot: np.ndarray
    other: np.ndarray | None
    step: np.ndarray


def obstacle_rings(floor: FloorMap) -> list[Float[np.ndarray, "corners 2"]]:
    """Corners of boxes and polygons."""
    rings = []
    for x, y, w, h in floor.boxes:
        rings.append(
            np.array([(x - w / 2, y - h / 2), (x + w / 2, y - h / 2), (x + w / 2, y + h / 2), (x - w / 2, y + h / 2)])
        )  # fmt: skip
    return rings + [np.array(corners) for corners in floor.polygons]


def _outside(condition: FleetCondition, paths: Paths) -> Iterator[_Margins]:
    """Of every obstacle, numbered with boxes first, then polygons, then discs."""
    floor, robots = condition.floor, len(paths)
    first, last = paths[:, :-1].reshape(-1, 2), paths[:, 1:].reshape(-1, 2)
    robot, step = np.divmod(np.arange(len(first)), paths.shape[1] - 1)
    rings = obstacle_rings(floor)
    for numbers in _together(rings, len(first)):
        group = np.array([rings[k] for k in numbers])
        ring, part, distance = _nearest_steps(first, last, group, condition.radius)
        margin = distance - condition.radius
        yield _Margins("outside", margin, robot[part], numbers[ring], step[part])
    for k, (x, y, radius) in enumerate(floor.discs, start=len(rings)):
        near = point_from_segment(np.array([x, y]), first, last)
        margin = near - radius - condition.radius
        yield _Margins("outside", margin, robot, np.full(len(first), k), step)
    assert robots


def _together(
    rings: Sequence[Float[np.ndarray, "_ 2"]], steps: int
) -> Iterator[Int[np.ndarray, " _"]]:
    """Numbers of polygons with equally many corners, not too many at once."""
    corners = np.array([len(ring) for ring in rings], int)
    for count in np.unique(corners):
        numbers = np.flatnonzero(corners == count)
        yield from np.array_split(numbers, -(-len(numbers) * steps // PAIRS))


def _nearest_steps(
    first: Float[np.ndarray, "steps 2"],
    last: Float[np.ndarray, "steps 2"],
    rings: Float[np.ndarray, "rings corners 2"],
    reach: float,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"], Float[np.ndarray, " pairs"]]:
    """Polygons, segments and their distances, of all pairs that are within reach or can be the nearest of a polygon."""
    half, middle = _norm(last - first) / 2, (first + last) / 2
    low, high = rings.min(1)[:, None], rings.max(1)[:, None]
    # A lower bound, by the box around the polygon, and one upper bound of the least distance.
    bound = _norm(np.maximum(np.maximum(low - middle, middle - high), 0.0)) - half
    nearest = bound.argmin(1)
    least = segment_from_ring(first[nearest], last[nearest], rings)
    ring, part = np.nonzero(bound <= np.maximum(least, reach)[:, None])
    return ring, part, segment_from_ring(first[part], last[part], rings[ring])


def _margins(condition: FleetCondition, paths: Paths) -> Iterator[_Margins]:
    robots, waypoints, _ = paths.shape
    robot, step = np.divmod(np.arange(robots * (waypoints - 1)), waypoints - 1)
    away = np.stack(
        [_norm(paths[:, 0] - condition.starts), _norm(paths[:, -1] - condition.goals)], axis=1
    )
    ends = np.where(away == 0, np.inf, -away).ravel()
    places = np.tile([0, waypoints - 2], robots)
    yield _Margins("ends", ends, np.repeat(np.arange(robots), 2), None, places)
    first, second = np.triu_indices(robots, 1)
    if len(first):
        offset = paths[first] - paths[second]
        near = point_from_segment(np.zeros(2), offset[:, :-1], offset[:, 1:])
        margin = (near - APART * condition.radius).ravel()
        pair, at = np.divmod(np.arange(len(margin)), waypoints - 1)
        yield _Margins("apart", margin, first[pair], second[pair], at)
    low, high = np.reshape(condition.floor.bounds, (2, 2))
    room = np.minimum(paths - low, high - paths).min(-1) - condition.radius
    yield _Margins("inside", np.minimum(room[:, :-1], room[:, 1:]).ravel(), robot, None, step)
    if condition.floor.boxes or condition.floor.discs or condition.floor.polygons:
        parts = list(_outside(condition, paths))
        columns = (np.concatenate(column) for column in list(zip(*parts, strict=True))[1:])
        yield _Margins("outside", *columns)
    speed = condition.speed_limit - _norm(np.diff(paths, axis=1))
    yield _Margins("speed", speed.ravel(), robot, None, step)


def _verdict(condition: FleetCondition, paths: Paths) -> Verdict:
    misses, violation, blocked = [], 0.0, set()
    for kind in _margins(condition, paths):
        margin = np.where(np.isnan(kind.margin), -np.inf, kind.margin)
        k = int(margin.argmin())
        other = None if kind.other is None else int(kind.other[k])
        misses.append(
            Miss(kind.kind, float(margin[k]), int(kind.robot[k]), other, int(kind.step[k]))
        )
        short = margin < 0
        violation += float(np.sum(margin[short] ** 2) / 2)
        blocked.update(kind.robot[short].tolist())
        if kind.kind == "apart" and kind.other is not None:
            blocked.update(kind.other[short].tolist())
    return Verdict(tuple(misses), violation, tuple(sorted(blocked)))


def judge(conditions: Sequence[FleetCondition], paths: Sequence[Paths]) -> list[Verdict]:
    """The verdict on every plan; paths must be finite."""
    return [_verdict(condition, each) for condition, each in zip(conditions, paths, strict=True)]
