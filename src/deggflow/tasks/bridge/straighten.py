"""Shortens paths in space and time: fewer turns, and slow driving instead of stop-and-go."""

import numpy as np
from jaxtyping import Bool, Float, Int

from .ground import EXACT, Clear, nearest_approach
from .planner import TimedPath

ROUNDS = 3
SPACING = 3  # ticks between the points of a way that may become its turns


def straighten(ways: list[TimedPath], clear: Clear, clearance: float) -> list[TimedPath]:
    """The paths of least kinetic energy through points of the given ones, at the same ticks.

    Args:
        ways: One path per robot, without conflicts; the returned ones have none either.
        clear: Whether a robot alone may drive straight from points to points.
        clearance: Least distance of two robots' centres (m).
    """
    ways, count = list(ways), max(int(way.ticks[-1]) for way in ways) + 1
    tracks = np.stack([way.at_ticks(count) for way in ways])
    for turn in range(ROUNDS):
        for robot, way in enumerate(ways):
            knots = way if turn == 0 else _resampled(way)
            others = np.delete(tracks, robot, axis=0)
            ways[robot] = _relaxed(knots, others, clear, clearance)
            tracks[robot] = ways[robot].at_ticks(count)
    return ways


def _resampled(way: TimedPath) -> TimedPath:
    """The same path with knots every `SPACING` ticks."""
    ticks = np.union1d(way.ticks, np.arange(0, way.ticks[-1], SPACING))
    return TimedPath(ticks, way.at_ticks(int(ticks[-1]) + 1)[ticks])


def _relaxed(
    way: TimedPath, others: Float[np.ndarray, "others ticks 2"], clear: Clear, clearance: float
) -> TimedPath:
    """Shortest path over the knots, where straight moves from any to any later one are allowed."""
    count = len(way.ticks)
    energy, before = np.full(count, np.inf), np.zeros(count, int)
    energy[0] = 0.0
    for knot in range(count - 1):
        if not np.isfinite(energy[knot]):
            continue
        later = np.arange(knot + 1, count)
        start = np.broadcast_to(way.points[knot], (len(later), 2))
        free = clear(start, way.points[later])
        free[free] = _apart(way, knot, later[free], others, clearance - EXACT)
        free[0] = True  # as on the given path
        later = later[free]
        lasts = way.ticks[later] - way.ticks[knot]
        value = energy[knot] + np.sum((way.points[later] - way.points[knot]) ** 2, -1) / lasts
        better = value < energy[later]
        energy[later[better]], before[later[better]] = value[better], knot
    chain = [count - 1]
    while chain[-1] > 0:
        chain.append(int(before[chain[-1]]))
    return TimedPath(way.ticks[chain[::-1]], way.points[chain[::-1]])


def _apart(
    way: TimedPath,
    knot: int,
    later: Int[np.ndarray, " segments"],
    others: Float[np.ndarray, "others ticks 2"],
    clearance: float,
) -> Bool[np.ndarray, " segments"]:
    """Whether the straight moves from one knot to later ones keep clear of the other robots."""
    if not len(later) or not len(others):
        return np.ones(len(later), bool)
    begin, end = int(way.ticks[knot]), way.ticks[later]
    ticks = np.arange(begin, int(end.max()) + 1)
    share = np.minimum((ticks - begin) / (end - begin)[:, None], 1.0)
    own = way.points[knot] + share[..., None] * (way.points[later] - way.points[knot])[:, None]
    gap = own[:, None] - others[None, :, ticks]
    near = nearest_approach(gap[:, :, :-1], gap[:, :, 1:]).min(1)
    return np.where(ticks[:-1] < end[:, None], near, np.inf).min(-1) >= clearance
