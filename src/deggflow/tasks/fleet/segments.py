"""Distances of points and segments from segments and polygons in closed form, in float64; for verdicts alone."""

import numpy as np
from jaxtyping import Float

Vectors = Float[np.ndarray, "... 2"]


def norm(vector: Vectors) -> Float[np.ndarray, "..."]:
    """Length of vectors."""
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
    return norm(from_a - share[..., None] * way)


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
