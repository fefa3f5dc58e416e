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
    move = end - start
    free = np.ones(np.broadcast_shapes(start.shape, end.shape)[:-1], bool)
    safe = np.where(np.abs(move) < _TINY, _TINY, move)
    for x, y, width, height in floor.boxes:  # slab test
        half = np.array([width, height]) / 2 + margin
        first = (np.array([x, y]) - half - start) / safe
        second = (np.array([x, y]) + half - start) / safe
        enter = np.minimum(first, second).max(-1)
        leave = np.maximum(first, second).min(-1)
        free &= ~((enter < leave) & (leave > 0) & (enter < 1))
    square = np.maximum(np.sum(move**2, axis=-1), _TINY)
    for x, y, radius in floor.discs:
        to_centre = np.array([x, y]) - start
        share = np.clip(np.sum(to_centre * move, axis=-1) / square, 0.0, 1.0)
        nearest = to_centre - share[..., None] * move
        free &= np.hypot(nearest[..., 0], nearest[..., 1]) >= radius + margin
    if floor.polygons:
        moves = shapely.linestrings(np.stack(np.broadcast_arrays(start, end), axis=-2))
        for corners in floor.polygons:
            free &= shapely.distance(moves, shapely.Polygon(corners)) >= margin
    return free
