"""Exact geometry of verdicts: signed distances in the precision of their arguments, float64 in certificates.

Guidance does not use this file, and this file uses nothing of guidance: whatever is smoothed there is exact here.
Coordinates come first; all other axes broadcast. No function is meant to be differentiated.
"""

import itertools

import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, "_ ..."]


def norm(vector: Vector) -> Float[Array, "..."]:
    """Euclidean length along the first axis."""
    return jnp.sqrt(jnp.sum(vector**2, axis=0))


def segment_from_origin(first: Vector, last: Vector) -> Float[Array, "..."]:
    """Distance of the origin to straight segments."""
    way = last - first
    square = jnp.sum(way**2, axis=0)
    s = jnp.clip(-jnp.sum(first * way, axis=0) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
    inner = norm(first + s[None] * way)
    return jnp.minimum(inner, jnp.minimum(norm(first), norm(last)))


def point_from_box(point: Vector, half: Vector) -> Float[Array, "..."]:
    """Signed distance of points to boxes around the origin, negative inside."""
    gap = jnp.abs(point) - half
    return norm(jnp.maximum(gap, 0.0)) + jnp.minimum(jnp.max(gap, axis=0), 0.0)


def segment_from_box(first: Vector, last: Vector, half: Vector) -> Float[Array, "..."]:
    """Signed distance of segments to boxes around the origin; of overlap, minus the least translation that parts them.

    The squared distance is convex and piecewise quadratic along the segment. Its least value is at a stationary point of
    one of its pieces, each of which has every coordinate below, within or above the box, or at an end.
    """
    way = last - first
    least = jnp.minimum(point_from_box(first, half), point_from_box(last, half))
    outside = jnp.maximum(least, 0.0)
    for sides in itertools.product((-1.0, 0.0, 1.0), repeat=len(first)):
        side = jnp.asarray(sides, first.dtype).reshape(-1, *(1,) * (first.ndim - 1))
        active = jnp.abs(side)
        square = jnp.sum(active * way**2, axis=0)
        slope = jnp.sum(active * way * (first - side * half), axis=0)
        s = jnp.clip(-slope / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
        # Of the true distance: a stationary point of another piece is some point of the segment.
        gap = jnp.maximum(jnp.abs(first + s[None] * way) - half, 0.0)
        outside = jnp.minimum(outside, norm(gap))
    depth = _box_gap(first, last, half)
    crosses = depth < 0
    return jnp.where(crosses, depth, outside)


def _box_gap(first: Vector, last: Vector, half: Vector) -> Float[Array, "..."]:
    """Largest gap along the axes that can part a segment from a box: faces, and those normal to edge and segment."""
    low, high = jnp.minimum(first, last), jnp.maximum(first, last)
    gap = jnp.max(jnp.maximum(low - half, -high - half), axis=0)
    way = last - first
    if len(first) == 2:
        normals = [jnp.stack([-way[1], way[0]])]
    else:
        zero = jnp.zeros_like(way[0])
        normals = [
            jnp.stack([zero, way[2], -way[1]]),
            jnp.stack([-way[2], zero, way[0]]),
            jnp.stack([way[1], -way[0], zero]),
        ]
    for normal in normals:
        size = norm(normal)
        over = jnp.abs(jnp.sum(normal * first, axis=0)) - jnp.sum(jnp.abs(normal) * half, axis=0)
        gap = jnp.maximum(gap, jnp.where(size > 0, over / jnp.where(size > 0, size, 1.0), -jnp.inf))
    return gap


def polygons_apart(
    one: Float[Array, "_ 2 ..."], other: Float[Array, "_ 2 ..."]
) -> Float[Array, "..."]:
    """Signed distance of convex polygons by their corners, segments and points among them.

    Separated: the least distance of a corner of one to an edge of the other. Overlapping: minus the least translation
    that parts them, which is along a normal of an edge.
    """
    gap = jnp.maximum(_edge_gap(one, other), _edge_gap(other, one))
    near = jnp.minimum(_corner_distance(one, other), _corner_distance(other, one))
    return jnp.where(gap < 0, gap, near)


def point_from_ring(
    point: Float[Array, "2 ..."], ring: Float[Array, "corners 2"]
) -> Float[Array, "..."]:
    """Signed distance of points to a simple polygon: to its edges, and negative where a ray crosses an odd number of them."""
    a = ring.T.reshape(2, -1, *(1,) * (point.ndim - 1))
    b, x = jnp.roll(a, -1, axis=1), point[:, None]
    near = jnp.min(segment_from_origin(a - x, b - x), axis=0)
    between = (a[1] > x[1]) != (b[1] > x[1])
    slope = (b[0] - a[0]) / jnp.where(between, b[1] - a[1], 1.0)
    crossed = between & (x[0] < a[0] + (x[1] - a[1]) * slope)
    return jnp.where(jnp.sum(crossed, axis=0) % 2 == 1, -near, near)


def segment_from_ring(
    first: Float[Array, "2 ..."], last: Float[Array, "2 ..."], ring: Float[Array, "corners 2"]
) -> Float[Array, "..."]:
    """Distance of segments to a simple polygon; of those that enter it, minus how deep points of theirs are inside.

    Edges cut a segment into parts, each of which is inside or outside as a whole: the depths are those of the parts'
    middles and of both ends.
    """
    a = ring.T.reshape(2, -1, *(1,) * (first.ndim - 1))
    edge, way, off = jnp.roll(a, -1, axis=1) - a, (last - first)[:, None], a - first[:, None]
    turn, square = way[0] * edge[1] - way[1] * edge[0], jnp.sum(way**2, axis=0)
    crossing = (off[0] * edge[1] - off[1] * edge[0]) / jnp.where(turn == 0, 1.0, turn)
    # An edge along the segment cuts it at the edge's corners.
    corner = jnp.sum(off * way, axis=0) / jnp.where(square > 0, square, 1.0)
    ends = jnp.zeros_like(square), jnp.ones_like(square)
    cuts = jnp.clip(jnp.concatenate([*ends, crossing, corner]), 0.0, 1.0)
    cuts = jnp.sort(cuts, axis=0)
    middles = (cuts[1:] + cuts[:-1]) / 2
    at = jnp.concatenate([*ends, middles])[None]
    signed = point_from_ring(first[:, None] + at * way, ring)
    deepest = jnp.min(signed, axis=0)
    near = jnp.min(segment_from_origin(-off, last[:, None] - a), axis=0)
    return jnp.where(deepest < 0, deepest, jnp.minimum(near, jnp.min(signed[:2], axis=0)))


def _edge_gap(one: Float[Array, "_ 2 ..."], other: Float[Array, "_ 2 ..."]) -> Float[Array, "..."]:
    """Largest gap along the normals of one polygon's edges, both ways; -inf where it has none."""
    best = jnp.asarray(-jnp.inf, one.dtype)
    for k in range(len(one)):
        edge = one[(k + 1) % len(one)] - one[k]
        normal = jnp.stack([edge[1], -edge[0]])
        size = norm(normal)
        unit = normal / jnp.where(size > 0, size, 1.0)[None]
        own = jnp.sum(unit[None] * one, axis=1)
        its = jnp.sum(unit[None] * other, axis=1)
        gap = jnp.maximum(
            jnp.min(its, axis=0) - jnp.max(own, axis=0), jnp.min(own, axis=0) - jnp.max(its, axis=0)
        )
        gap = jnp.where(size > 0, gap, -jnp.inf)
        best = jnp.maximum(best, gap)
    return best


def _corner_distance(
    corners: Float[Array, "_ 2 ..."], polygon: Float[Array, "_ 2 ..."]
) -> Float[Array, "..."]:
    """Least distance of corners to the edges of a polygon."""
    best = jnp.asarray(jnp.inf, polygon.dtype)
    for k in range(len(polygon)):
        a, b = polygon[k], polygon[(k + 1) % len(polygon)]
        for corner in corners:
            near = segment_from_origin(a - corner, b - corner)
            best = jnp.minimum(best, near)
    return best
