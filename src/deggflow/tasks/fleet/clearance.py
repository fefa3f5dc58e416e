"""Distances of points from a map's obstacles, and straight moves among them, in float64."""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from .maps import FloorMap

_TINY = 1e-12

Points = Float[np.ndarray, "*rows 2"]


def clearance(floor: FloorMap, points: Points) -> Float[np.ndarray, "*rows"]:
    """Signed distance to the nearest obstacle, negative inside it; infinite on a map without any."""
    distance = np.full(points.shape[:-1], np.inf)
    for x, y, width, height in floor.boxes:
        beyond_x = np.abs(points[..., 0] - x) - width / 2
        beyond_y = np.abs(points[..., 1] - y) - height / 2
        outside = np.hypot(np.maximum(beyond_x, 0), np.maximum(beyond_y, 0))
        inside = np.minimum(np.maximum(beyond_x, beyond_y), 0)
        distance = np.minimum(distance, outside + inside)
    for x, y, radius in floor.discs:
        away = np.hypot(points[..., 0] - x, points[..., 1] - y) - radius
        distance = np.minimum(distance, away)
    for corners in floor.polygons:
        shape, places = shapely.Polygon(corners), shapely.points(points)
        away = shapely.distance(shape.exterior, places)
        distance = np.minimum(distance, np.where(shapely.contains(shape, places), -away, away))
    return distance


def within(floor: FloorMap, points: Points, margin: float) -> Bool[np.ndarray, "*rows"]:
    """Whether points lie inside the bounds by at least a margin."""
    low, high = np.reshape(floor.bounds, (2, 2))
    return np.all((points >= low + margin) & (points <= high - margin), axis=-1)


def straight(
    floor: FloorMap,
    start: Float[np.ndarray, "... 2"],
    end: Float[np.ndarray, "... 2"],
    margin: float,
) -> Bool[np.ndarray, "..."]:
    """Whether straight moves keep a margin from every box, in both coordinates, from every disc and polygon."""
    # One array for each coordinate: reductions over an axis of two take many times as long.
    start_x, start_y = start[..., 0], start[..., 1]
    move_x, move_y = end[..., 0] - start_x, end[..., 1] - start_y
    free = np.ones(move_x.shape, bool)
    if floor.boxes:
        safe_x, safe_y = (np.where(np.abs(m) < _TINY, _TINY, m) for m in (move_x, move_y))
    for x, y, width, height in floor.boxes:  # slab test
        enter_x, leave_x = _slab(x, width / 2 + margin, start_x, safe_x)
        enter_y, leave_y = _slab(y, height / 2 + margin, start_y, safe_y)
        enter, leave = np.maximum(enter_x, enter_y), np.minimum(leave_x, leave_y)
        free &= ~((enter < leave) & (leave > 0) & (enter < 1))
    square = np.maximum(move_x**2 + move_y**2, _TINY)
    for x, y, radius in floor.discs:
        to_x, to_y = x - start_x, y - start_y
        share = np.clip((to_x * move_x + to_y * move_y) / square, 0.0, 1.0)
        away = (to_x - share * move_x) ** 2 + (to_y - share * move_y) ** 2
        free &= away >= (radius + margin) ** 2
    if floor.polygons:
        moves = shapely.linestrings(np.stack(np.broadcast_arrays(start, end), axis=-2))
        for corners in floor.polygons:
            free &= shapely.distance(moves, shapely.Polygon(corners)) >= margin
    return free


def _slab(
    centre: float,
    half: float,
    start: Float[np.ndarray, "..."],
    move: Float[np.ndarray, "..."],
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Shares of a move at which it enters and leaves a range of one coordinate."""
    first, second = (centre - half - start) / move, (centre + half - start) / move
    return np.minimum(first, second), np.maximum(first, second)
