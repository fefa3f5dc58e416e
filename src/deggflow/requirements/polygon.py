"""Simple polygons in NumPy: direction, convexity, hull, triangles. Used when regions are made, not in compiled programs."""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Float

Ring = Float[np.ndarray, "_ 2"]
Vectors = Float[np.ndarray, "... 2"]
Triangles = Float[np.ndarray, "_ 3 2"]


def _cross(a: Vectors, b: Vectors) -> Any:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def counter_clockwise(corners: Float[np.ndarray, "..."]) -> Ring:
    """The corners counter-clockwise, each once, without those within an edge.

    Raises:
        ValueError: They are not at least three points of the plane that enclose an area, or edges cross.
    """
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise ValueError(
            f"`corners` must be finite, of shape (corners, 2); got shape {corners.shape}."
        )
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]
    corners = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]
    area = _cross(corners - corners[:1], np.roll(corners, -1, axis=0) - corners[:1]).sum() / 2
    if len(corners) < 3 or area == 0:
        raise ValueError(f"`corners` must enclose an area; got {corners.tolist()}.")
    ring = _without_corners_in_edges(corners)
    if not shapely.LinearRing(ring).is_simple:
        raise ValueError(
            "`corners` must be a simple polygon, whose edges neither cross nor touch each other; got "
            f"{corners.tolist()}."
        )
    return ring if area > 0 else ring[::-1]


def _without_corners_in_edges(ring: Ring) -> Ring:
    """Corners at which the ring turns by more than the rounding of their coordinates; where it turns back, it is kept."""
    rounding = _rounding(ring)
    rest, k = list(ring), 0
    while k < len(rest) > 3:
        one, other = rest[k] - rest[k - 1], rest[(k + 1) % len(rest)] - rest[k]
        size = np.abs(one).sum() + np.abs(other).sum()
        if abs(_cross(one, other)) <= rounding * size and one @ other > 0:
            del rest[k]
        else:
            k += 1
    return np.array(rest)


def _rounding(ring: Ring) -> float:
    """By how much corners may be beside a line that they are meant to be on."""
    return float(8 * np.finfo(float).eps * np.abs(ring).max())


def _turns(ring: Ring) -> Float[np.ndarray, " corners"]:
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    return _cross(ring - before, after - ring)


def is_convex(ring: Ring) -> bool:
    """Whether a ring turns left at every corner."""
    return bool((_turns(ring) >= 0).all())


def convex_hull(ring: Ring) -> Ring:
    """Corners of the hull, counter-clockwise (Andrew's monotone chain)."""
    points = ring[np.lexsort((ring[:, 1], ring[:, 0]))]

    def chain(points: Ring) -> list[np.ndarray]:
        out: list[np.ndarray] = []
        for point in points:
            while len(out) > 1 and _cross(out[-1] - out[-2], point - out[-1]) <= 0:
                out.pop()
            out.append(point)
        return out[:-1]

    return np.array(chain(points) + chain(points[::-1]))


def triangles(ring: Ring) -> Triangles:
    """Triangles that fill a ring, by cutting ears off."""
    rest, out = list(ring), []
    while len(rest) > 3:
        k = _ear(np.array(rest))
        out.append([rest[k - 1], rest[k], rest[(k + 1) % len(rest)]])
        del rest[k]
    out.append(rest)
    whole = np.array(out)
    flat = _cross(whole[:, 1] - whole[:, 0], whole[:, 2] - whole[:, 0]) == 0
    return whole[~flat]


def _ear(ring: Ring) -> int:
    turns = _turns(ring)
    # A corner beside the ear's third edge may be meant to be on it.
    for rounding in (_rounding(ring), 0.0):
        for k in range(len(ring)):
            if turns[k] == 0:
                return k  # a corner within an edge
            triangle = ring[[k - 1, k, (k + 1) % len(ring)]]
            others = np.delete(ring, [(k - 1) % len(ring), k, (k + 1) % len(ring)], axis=0)
            if turns[k] > 0 and not _within(others, triangle, rounding).any():
                return k
    raise ValueError(
        f"`corners` must be a simple polygon, whose edges neither cross nor touch each other; got {ring.tolist()}."
    )


def _within(points: Ring, triangle: Ring, rounding: float) -> np.ndarray:
    edge = np.roll(triangle, -1, axis=0) - triangle
    sides = _cross(edge[None], points[:, None] - triangle[None])
    same = (points[:, None] == triangle[None]).all(axis=-1).any(axis=1)
    return (sides >= -rounding * np.abs(edge).sum(axis=1)).all(axis=1) & ~same


def notches(ring: Ring) -> list[Ring]:
    """Polygons that fill the convex hull outside of a ring."""
    hull = convex_hull(ring)
    edge = np.roll(hull, -1, axis=0) - hull
    beside = np.abs(_cross(edge[None], ring[:, None] - hull[None])) / np.abs(edge).sum(axis=1)
    on_hull = (beside.min(axis=1) <= _rounding(ring)).tolist()
    first = on_hull.index(True)
    order = [(first + k) % len(ring) for k in range(len(ring) + 1)]
    out, pocket = [], [order[0]]
    for k in order[1:]:
        pocket.append(k)
        if on_hull[k]:
            if len(pocket) > 2:
                out.append(ring[pocket][::-1])
            pocket = [k]
    return out
