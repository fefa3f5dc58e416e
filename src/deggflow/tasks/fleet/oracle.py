"""Plans checked by Shapely and at many moments in time, without the code of the verdict."""

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry import Point, Polygon, box

from .condition import FleetCondition

TOLERANCE = 1e-9  # map units, of rounding
MOMENTS = 32  # between two waypoints
PAIR = 2.1  # radii, MMD's own check

Paths = Float[np.ndarray, "robots 64 2"]


def _obstacles(condition: FleetCondition) -> list[shapely.Geometry]:
    floor = condition.floor
    shapes = [box(x - w / 2, y - h / 2, x + w / 2, y + h / 2) for x, y, w, h in floor.boxes]
    return shapes + [Polygon(corners) for corners in floor.polygons]


def refutes(condition: FleetCondition, paths: Paths) -> bool:
    """Whether a plan misses a requirement, up to rounding."""
    radius, lines = condition.radius, shapely.linestrings(paths)
    if not (paths[:, 0] == condition.starts).all() or not (paths[:, -1] == condition.goals).all():
        return True
    inner = np.array(shapely.bounds(lines)) + radius * np.array([-1.0, -1.0, 1.0, 1.0])
    low_x, low_y, high_x, high_y = condition.floor.bounds
    if (inner[:, :2] < np.array([low_x, low_y]) - TOLERANCE).any():
        return True
    if (inner[:, 2:] > np.array([high_x, high_y]) + TOLERANCE).any():
        return True
    for shape in _obstacles(condition):
        if (shapely.distance(lines, shape) < radius - TOLERANCE).any():
            return True
    for x, y, size in condition.floor.discs:
        if (shapely.distance(lines, Point(x, y)) < size + radius - TOLERANCE).any():
            return True
    steps = np.hypot(*np.moveaxis(np.diff(paths, axis=1), -1, 0))
    return bool((steps > condition.speed_limit + TOLERANCE).any()) or _too_close(condition, paths)


def _too_close(condition: FleetCondition, paths: Paths) -> bool:
    """Whether two robots are too close at one of many moments, or their relative path passes too close to zero."""
    if len(paths) < 2:
        return False
    least = PAIR * condition.radius - TOLERANCE
    for moment in np.arange(MOMENTS) / MOMENTS:
        at = (1 - moment) * paths[:, :-1] + moment * paths[:, 1:]
        complex_at = at[..., 0] + 1j * at[..., 1]
        gap = np.abs(complex_at[:, None] - complex_at[None])
        gap[np.arange(len(at)), np.arange(len(at))] = np.inf
        if gap.min() < least:
            return True
    one, other = np.triu_indices(len(paths), 1)
    relative = shapely.linestrings(paths[one] - paths[other])
    return bool((shapely.distance(relative, Point(0.0, 0.0)) < least).any())
