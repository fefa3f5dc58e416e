"""Roadmaps of a map: short ways around its obstacles, several of them by random weights of moves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from .clearance import clearance, straight, within
from .maps import FloorMap

MARGIN = 0.068  # map units, from obstacles along a way: radius and some room
_CORNER = 0.08  # distance of roadmap points from the sides of a box
_SIDES = 8  # of the polygon around a disc
_EDGE = 0.07  # least distance from the bounds
_SCATTERED = 40  # random points, so that ways differ
_NOISE = 0.25  # standard deviation of log weights of moves
BACKWARDS = 8.0  # weight of moves against a one-way ring, as on highways

Points = Float[np.ndarray, "points 2"]


class Roadmap(NamedTuple):
    """Shortest ways among points, for several random weights of the moves.

    Attributes:
        floor: The map.
        points: Where ways may turn.
        length: Weighted length of the shortest way from point to point.
        before: The last point before the second one on it.
        one_way: Whether ways lead counter-clockwise round the origin.
    """

    floor: FloorMap
    points: Points
    length: Float[np.ndarray, "variants points points"]
    before: Int[np.ndarray, "variants points points"]
    one_way: bool

    def weight(
        self, start: Float[np.ndarray, "... 2"], end: Float[np.ndarray, "... 2"]
    ) -> Float[np.ndarray, "..."]:
        """Weighted length of straight moves; infinite where they are blocked."""
        return _weight(self.floor, start, end, self.one_way)

    def way(
        self, variant: int, start: Float[np.ndarray, " 2"], goal: Float[np.ndarray, " 2"]
    ) -> Float[np.ndarray, "corners 2"]:
        """Corners of a way, both ends included; the straight line where there is none."""
        direct = self.weight(start, goal)
        if not len(self.points):
            return np.stack([start, goal])
        into, out = self.weight(start, self.points), self.weight(self.points, goal)
        total = into[:, None] + self.length[variant] + out[None]
        first, last = np.unravel_index(np.argmin(total), total.shape)
        if direct <= total[first, last] or not np.isfinite(total[first, last]):
            return np.stack([start, goal])
        chain = [last]
        while chain[-1] != first:
            chain.append(self.before[variant, first, chain[-1]])
        return np.concatenate([start[None], self.points[chain[::-1]], goal[None]])


def _weight(
    floor: FloorMap,
    start: Float[np.ndarray, "... 2"],
    end: Float[np.ndarray, "... 2"],
    one_way: bool,
) -> Float[np.ndarray, "..."]:
    length = np.linalg.norm(end - start, axis=-1)
    if one_way:
        turn = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
        length = length * np.where(turn < 0, BACKWARDS, 1.0)
    return np.where(straight(floor, start, end, MARGIN), length, np.inf)


def _points(floor: FloorMap, rng: np.random.Generator) -> Points:
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    around = [
        np.array([x, y]) + corners * (np.array([w, h]) / 2 + _CORNER) for x, y, w, h in floor.boxes
    ]
    around += [
        np.array([x, y]) + circle * (r + _CORNER) / np.cos(np.pi / _SIDES)
        for x, y, r in floor.discs
    ]
    low, high = np.reshape(floor.bounds, (2, 2))
    points = np.concatenate([*around, rng.uniform(low, high, (_SCATTERED, 2))])
    free = clearance(floor, points) >= MARGIN
    return points[free & within(floor, points, _EDGE)]


def make_roadmap(
    floor: FloorMap, rng: np.random.Generator, variants: int, *, one_way: bool = False
) -> Roadmap:
    """The roadmap of a map of boxes and discs.

    Args:
        floor: The map.
        rng: Draws points and weights.
        variants: How many weightings of the moves; each has shortest ways of its own.
        one_way: Whether ways lead counter-clockwise round the origin where they can.
    """
    points = _points(floor, rng) if floor.boxes or floor.discs else np.zeros((0, 2))
    count = len(points)
    weight = _weight(floor, points[:, None], points[None, :], one_way)
    lengths, predecessors = (
        np.zeros((variants, count, count)),
        np.zeros((variants, count, count), int),
    )
    if not count:
        return Roadmap(floor, points, lengths, predecessors, one_way)
    tail, head = np.nonzero(np.isfinite(weight) & ~np.eye(count, dtype=bool))
    for k in range(variants):
        of_point = np.exp(_NOISE * rng.normal(size=count))  # moves share the weights of their ends
        value = weight[tail, head] * np.sqrt(of_point[tail] * of_point[head])
        graph = csr_array((value, (tail, head)), shape=(count, count))
        lengths[k], predecessors[k] = dijkstra(graph, return_predecessors=True)
    return Roadmap(floor, points, lengths, predecessors, one_way)
