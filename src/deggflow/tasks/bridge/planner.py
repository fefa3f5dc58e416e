"""Paths for many robots at once: prioritised planning in space and time (cooperative A*).

Robots are planned one after another. Each gets its best path among the moves that earlier ones leave free, by dynamic
programming over ticks for all points of the roadmap at once, without a heuristic. If a robot has no path, it becomes the
first and planning starts again (Erdmann and Lozano-Pérez 1987; Silver 2005; avoiding robots that still stand at their
starts: Čáp et al. 2015).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from .ground import EXACT, nearest_approach
from .roadmap import STRIDE, Roadmap
from .world import ROBOT_RADIUS

CLEARANCE = 2 * ROBOT_RADIUS + 0.02  # m, kept between the centres of two robots
HORIZON = 500  # ticks within which all robots must arrive
ATTEMPTS = 24  # orders tried
HASTE = STRIDE / 2  # m of detour that count as much as one tick


class NoWayError(ValueError):
    """A robot finds no path; the message names it, counting from 1."""


class TimedPath(NamedTuple):
    """Positions of a robot at some ticks; it drives straight at constant speed in between, and stays at the last one."""

    ticks: Int[np.ndarray, " knots"]  # the first is 0
    points: Float[np.ndarray, "knots 2"]

    def at_ticks(self, count: int) -> Float[np.ndarray, "count 2"]:
        """Positions at ticks 0 .. count - 1."""
        ticks = np.arange(count)
        return np.stack([np.interp(ticks, self.ticks, p) for p in self.points.T], -1)


def _forbidden(
    roadmap: Roadmap, way: Float[np.ndarray, "ticks 2"], clearance: float
) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"]]:
    """Moves that come closer than `clearance` to a robot on its path: ticks of departure, and moves."""
    start = roadmap.points[roadmap.tail]
    step = (roadmap.points[roadmap.head] - start) / roadmap.ticks[:, None]
    reach = clearance + roadmap.length / 2 + roadmap.ticks * STRIDE
    near = cKDTree(way).sparse_distance_matrix(roadmap.middles, reach.max(), output_type="ndarray")
    near = near[near["v"] < reach[near["j"]]]
    tick, move = near["i"], near["j"]
    occupancy = np.zeros(len(tick), bool)
    for k in range(int(roadmap.ticks.max())):
        on = np.nonzero(~occupancy & (roadmap.ticks[move] > k))[0]
        here = start[move[on]] + k * step[move[on]]
        a = here - way[np.minimum(tick[on] + k, len(way) - 1)]
        b = here + step[move[on]] - way[np.minimum(tick[on] + k + 1, len(way) - 1)]
        occupancy[on] = nearest_approach(a, b) < clearance
    return tick[occupancy], move[occupancy]


def _reserve(
    roadmap: Roadmap,
    occupied: Bool[np.ndarray, "ticks moves"],
    way: Float[np.ndarray, "moments 2"],
    clearance: float,
) -> None:
    """Marks moves that meet a robot on its path or at the end of it, where it stays."""
    tick, move = _forbidden(roadmap, way, clearance)
    end = tick + roadmap.ticks[move]
    in_time = end < len(occupied)
    occupied[end[in_time], move[in_time]] = True
    parked = move[tick == len(way) - 1]
    since = len(way) - 1 + roadmap.ticks[parked]
    occupied[:, parked] |= np.arange(len(occupied))[:, None] >= since[None]


def best_way(
    roadmap: Roadmap, occupied: Bool[np.ndarray, "ticks moves"], ends: tuple[int, int]
) -> TimedPath | None:
    """The path of least length plus `HASTE` times duration at whose end the robot can stay.

    Args:
        roadmap: Where robots drive.
        occupied: Moves that are not free, by the tick at which they end.
        ends: Points at which the path begins and ends.
    """
    start, goal = ends
    passing = np.nonzero(occupied[:, roadmap.wait[goal]])[0]
    settled = passing.max(initial=0)  # no robot passes the goal later
    if settled == len(occupied) - 1:
        return None
    pad = int(roadmap.ticks.max())  # rows before tick 0, so that nothing departs there
    length = np.full((pad + len(occupied), len(roadmap.points)), np.inf)
    length[pad, start] = 0.0
    crow = float(np.linalg.norm(roadmap.points[goal] - roadmap.points[start]))
    best, arrival = np.inf, 0
    for tick in range(1, len(occupied)):
        through = length[pad + tick - roadmap.ticks, roadmap.tail] + roadmap.length
        through[occupied[tick]] = np.inf
        length[pad + tick] = np.minimum.reduceat(through, roadmap.first)
        value = length[pad + tick, goal] + HASTE * tick
        if tick >= settled and value < best:
            best, arrival = value, tick
        if crow + HASTE * tick >= best:
            break
    return _trace(roadmap, occupied, length[pad:], (goal, arrival)) if arrival else None


def _trace(
    roadmap: Roadmap,
    occupied: Bool[np.ndarray, "ticks moves"],
    length: Float[np.ndarray, "ticks points"],
    end: tuple[int, int],
) -> TimedPath:
    """The path, traced back from its end along the moves that gave each point its length."""
    point, tick = end
    ticks, points = [tick], [point]
    while tick > 0:
        into = np.arange(roadmap.first[point], roadmap.wait[point] + 1)
        into = into[(roadmap.ticks[into] <= tick) & ~occupied[tick, into]]
        through = length[tick - roadmap.ticks[into], roadmap.tail[into]] + roadmap.length[into]
        move = into[np.argmin(through)]
        tick, point = tick - int(roadmap.ticks[move]), int(roadmap.tail[move])
        ticks.append(tick)
        points.append(point)
    return TimedPath(np.array(ticks[::-1]), roadmap.points[points[::-1]])


def _in_order(
    roadmap: Roadmap, ends: list[tuple[int, int]], order: list[int], hold: int, clearance: float
) -> tuple[dict[int, TimedPath], int]:
    """Paths of the robots in this order, and the robot that has none (-1: all have one).

    Before tick `hold`, robots avoid the starts of those that come later in the order.
    """
    reserved = np.zeros((HORIZON + 1, len(roadmap.tail)), bool)
    standing = {i: _forbidden(roadmap, roadmap.points[[ends[i][0]]], clearance)[1] for i in order}
    ways: dict[int, TimedPath] = {}
    for place, robot in enumerate(order):
        occupied = reserved.copy()
        for later in order[place + 1 :]:
            occupied[:hold, standing[later]] = True
        way = best_way(roadmap, occupied, ends[robot])
        if way is None:
            return ways, robot
        ways[robot] = way
        _reserve(roadmap, reserved, way.at_ticks(int(way.ticks[-1]) + 1), clearance)
    return ways, -1


def plan(roadmap: Roadmap, ends: list[tuple[int, int]], seed: int) -> tuple[list[TimedPath], float]:
    """Paths on which no two robots come closer than a clearance, and the clearance: `CLEARANCE` or less.

    Args:
        roadmap: Where robots drive.
        ends: Points at which each robot begins and ends.
        seed: Of the random orders that are tried when the first ones fail.

    Raises:
        NoWayError: A robot cannot reach its goal, or no order was found in which all of them can.
    """
    clearance = _clearance(roadmap.points[np.array(ends).T])
    graph = csr_array((roadmap.length + 1e-12, (roadmap.tail, roadmap.head)))
    travel = dijkstra(graph, indices=[start for start, _ in ends])
    travel = np.array([row[goal] for row, (_, goal) in zip(travel, ends, strict=True)])
    if not np.isfinite(travel).all():
        robot = int(np.argmin(np.isfinite(travel)))
        raise NoWayError(f"robot {robot + 1} has no way to its goal, even alone")
    rng = np.random.default_rng(seed)
    order, attempts = [int(i) for i in np.argsort(travel)], set()
    for attempt in range(ATTEMPTS):
        attempts.add(tuple(order))
        hold = HORIZON + 1 if attempt % 2 == 0 else int(rng.integers(10, 80))
        ways, blocked = _in_order(roadmap, ends, order, hold, clearance)
        if blocked < 0:
            return [ways[i] for i in range(len(ends))], clearance
        order = [blocked, *(i for i in order if i != blocked)]
        if tuple(order) in attempts:
            order = [int(i) for i in rng.permutation(len(ends))]
    raise NoWayError(f"robot {blocked + 1} finds no way past the others in {ATTEMPTS} orders")


def _clearance(points: Float[np.ndarray, "ends robots 2"]) -> float:
    """`CLEARANCE`, or less where robots begin or end closer together."""
    apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)
    apart[:, *np.diag_indices(points.shape[1])] = np.inf
    least = float(apart.min())
    if least < 2 * ROBOT_RADIUS - EXACT:
        robot, other = sorted(int(i) for i in np.argwhere(apart == least)[0, 1:])
        raise NoWayError(f"robot {robot + 1} would overlap robot {other + 1} at its start or goal")
    return min(CLEARANCE, least - EXACT)
