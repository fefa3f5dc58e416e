"""Roadmaps of a map: short ways around its obstacles, several of them by random weights of moves."""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from .clearance import clearance, straight, within
from .maps import RADIUS, FloorMap
from .ways import Ways

# Distances in map units, beyond the robots' radius:
_ROOM = 0.018  # from obstacles along a way
_CORNER = 0.03  # of roadmap points from the sides of a box
_EDGE = 0.02  # of roadmap points from the bounds
_SIDES = 8  # of the polygon around a disc
_WORK = 40_000_000  # pairs of points times obstacles: large floors get fewer points
_PAIRS = 1_000_000  # of first and last points of ways, looked at at once
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
        radius: Of the robots.
    """

    floor: FloorMap
    points: Points
    length: Float[np.ndarray, "variants points points"]
    before: Int[np.ndarray, "variants points points"]
    one_way: bool
    radius: float

    def weight(
        self, start: Float[np.ndarray, "... 2"], end: Float[np.ndarray, "... 2"]
    ) -> Float[np.ndarray, "..."]:
        """Weighted length of straight moves; infinite where they are blocked."""
        move = end - start
        length = np.sqrt(move[..., 0] ** 2 + move[..., 1] ** 2)
        if self.one_way:
            turn = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
            length = length * np.where(turn < 0, BACKWARDS, 1.0)
        free = straight(self.floor, start, end, self.radius + _ROOM)
        return np.where(free, length, np.inf)

    def ways(
        self,
        ends: Float[np.ndarray, "2 robots 2"],
        variants: Int[np.ndarray, "robots each"],
    ) -> Ways:
        """Several ways of each robot, those of a robot one after the other; straight lines where there is none.

        Args:
            ends: Starts and goals.
            variants: Of the weights, for each way.
        """
        start, goal = ends
        which, robot = variants.ravel(), np.repeat(np.arange(len(variants)), variants.shape[1])
        if not len(self.points):
            return Ways.straight(start[robot], goal[robot])
        into = _open(self.weight(start[:, None], self.points[None]))
        out = _open(self.weight(self.points[None], goal[:, None]))
        pairs = into.points.shape[1] * out.points.shape[1]
        parts = np.array_split(np.arange(len(which)), -(-len(which) * pairs // _PAIRS))
        first, last, least = (
            np.concatenate(each)
            for each in zip(
                *(self._best(which[k], into.of(robot[k]), out.of(robot[k])) for k in parts),
                strict=True,
            )
        )
        straight = (self.weight(start, goal)[robot] <= least) | ~np.isfinite(least)
        chain = [np.where(straight, first, last)]
        while np.any(chain[-1] != first):
            chain.append(np.where(chain[-1] == first, first, self.before[which, first, chain[-1]]))
        backwards = np.array(chain)
        count = np.where(straight, 0, 1 + np.sum(backwards[:-1] != first, axis=0))
        return self._corners(backwards, count, start[robot], goal[robot])

    def _best(
        self, variants: Int[np.ndarray, " ways"], into: "_Moves", out: "_Moves"
    ) -> tuple[Int[np.ndarray, " ways"], Int[np.ndarray, " ways"], Float[np.ndarray, " ways"]]:
        """First and last point of each way, and its weighted length."""
        between = self.length[variants[:, None, None], into.points[:, :, None], out.points[:, None]]
        total = into.weight[:, :, None] + between + out.weight[:, None]
        total = total.reshape(len(total), -1)
        best, way = total.argmin(1), np.arange(len(total))
        enter, leave = np.divmod(best, out.points.shape[1])
        return into.points[way, enter], out.points[way, leave], total[way, best]

    def _corners(
        self,
        chain: Int[np.ndarray, "most ways"],
        count: Int[np.ndarray, " ways"],
        start: Float[np.ndarray, "ways 2"],
        goal: Float[np.ndarray, "ways 2"],
    ) -> Ways:
        """Args: chain: points of each way, from its last one back; count: how many of them it has."""
        place = count - np.arange(1, len(chain) + 1)[:, None]  # in the chain, of each corner
        points = self.points[np.take_along_axis(chain, np.maximum(place, 0), 0)]
        inner = np.where(place[..., None] >= 0, points, goal)
        corners = np.concatenate([start[None], inner, goal[None]]).swapaxes(0, 1)
        return Ways(corners, count + 2)


class _Moves(NamedTuple):
    """Straight moves from or to places; filled up with some that are blocked, of infinite weight."""

    points: Int[np.ndarray, "places most"]
    weight: Float[np.ndarray, "places most"]

    def of(self, rows: Int[np.ndarray, " rows"]) -> "_Moves":
        """Those of some places."""
        return _Moves(self.points[rows], self.weight[rows])


def _open(weight: Float[np.ndarray, "places points"]) -> _Moves:
    """Moves that are free."""
    free = np.isfinite(weight)
    points = np.argsort(~free, axis=1, kind="stable")[:, : max(1, free.sum(1).max())]
    return _Moves(points, np.take_along_axis(weight, points, 1))


def _points(floor: FloorMap, rng: np.random.Generator, radius: float) -> Points:
    away = radius + _CORNER
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    around = [
        np.array([x, y]) + corners * (np.array([w, h]) / 2 + away) for x, y, w, h in floor.boxes
    ]
    around += [
        np.array([x, y]) + circle * (r + away) / np.cos(np.pi / _SIDES) for x, y, r in floor.discs
    ]
    around += [
        shapely.get_coordinates(shapely.Polygon(corners).buffer(away, quad_segs=2).exterior)
        for corners in floor.polygons
    ]
    low, high = np.reshape(floor.bounds, (2, 2))
    points = np.concatenate([*around, rng.uniform(low, high, (_SCATTERED, 2))])
    free = clearance(floor, points) >= radius + _ROOM
    points = points[free & within(floor, points, radius + _EDGE)]
    most = int(np.sqrt(_WORK / floor.obstacles))
    return points if len(points) <= most else rng.choice(points, most, replace=False)


def make_roadmap(
    floor: FloorMap,
    rng: np.random.Generator,
    variants: int,
    *,
    one_way: bool = False,
    radius: float = RADIUS,
) -> Roadmap:
    """The roadmap of a map.

    Args:
        floor: The map.
        rng: Draws points and weights.
        variants: How many weightings of the moves; each has shortest ways of its own.
        one_way: Whether ways lead counter-clockwise round the origin where they can.
        radius: Of the robots.
    """
    points = _points(floor, rng, radius) if floor.obstacles else np.zeros((0, 2))
    count = len(points)
    lengths, predecessors = (
        np.zeros((variants, count, count)),
        np.zeros((variants, count, count), int),
    )
    roads = Roadmap(floor, points, lengths, predecessors, one_way, radius)
    if not count:
        return roads
    weight = roads.weight(points[:, None], points[None, :])
    tail, head = np.nonzero(np.isfinite(weight) & ~np.eye(count, dtype=bool))
    for k in range(variants):
        of_point = np.exp(_NOISE * rng.normal(size=count))  # moves share the weights of their ends
        value = weight[tail, head] * np.sqrt(of_point[tail] * of_point[head])
        graph = csr_array((value, (tail, head)), shape=(count, count))
        lengths[k], predecessors[k] = dijkstra(graph, return_predecessors=True)
    return roads
