"""Repulsion from convex polygons, and their faces: hinges summed over corners are smooth where a least distance is not."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .box import overlap
from .term import dot, hinge, nearest_on_the_way, root

Pieces = Float[Array | np.ndarray, "pieces corners 2"]
Positions = Float[Array, "2 agents waypoints"]
Each = Float[Array, "pieces agents steps"]


def _corners(pieces: Pieces) -> Float[Array, "_ 2 _ 1 1"]:
    return jnp.moveaxis(jnp.asarray(pieces), 0, 2)[..., None, None]


def normals(corner: Float[Array, "_ 2 ..."]) -> Float[Array, "_ 2 ..."]:
    """Outer unit normals of the edges, each from a corner to the next; zero for an edge of length zero."""
    edge = jnp.roll(corner, -1, axis=0) - corner
    normal = jnp.stack([edge[:, 1], -edge[:, 0]], axis=1)
    size = root(normal[:, :1] ** 2 + normal[:, 1:] ** 2)
    return normal / jnp.where(size > 0, size, 1.0)


def face_gaps(pieces: Pieces, x: Positions) -> Float[Array, "faces pieces agents waypoints"]:
    """How far positions are beyond the line of each face."""
    # By coordinates, for the reason that `point_distance` gives.
    corner = _corners(pieces)
    normal, x_, y_ = normals(corner), x[0][None, None], x[1][None, None]
    return normal[:, 0] * (x_ - corner[:, 0]) + normal[:, 1] * (y_ - corner[:, 1])


def repulsion(pieces: Pieces, x: Positions, reach: Any, eps: float) -> Each:
    """Hinges over the distances of waypoints to the pieces and of corners to the motion between waypoints.

    Where the motion crosses a piece, the least translation that parts them counts in addition. It is at least as long as
    the least of these distances, so that the sum is at least reach^2 / 2 there.
    """
    gaps = face_gaps(pieces, x)
    points = hinge(reach - point_distance(_corners(pieces), x[:, None], gaps))
    if x.shape[2] == 1:
        return points + overlap(jnp.max(gaps, axis=0), reach)
    first, last = x[:, None, :, :-1], x[:, None, :, 1:]
    way = last - first
    gap = jnp.max(jnp.minimum(gaps[..., :-1], gaps[..., 1:]), axis=0)
    total = jnp.zeros_like(gap)
    across = []
    for corner in _corners(pieces):
        total = total + hinge(reach - nearest_on_the_way(first - corner, way, eps))
        offset = corner - first
        across.append(way[0] * offset[1] - way[1] * offset[0])
    square = dot(way, way)
    still = square == 0
    side = jnp.stack(across) / jnp.sqrt(jnp.where(still, 1.0, square))[None]
    beside = jnp.maximum(jnp.min(side, axis=0), -jnp.max(side, axis=0))
    gap = jnp.maximum(gap, jnp.where(still, -jnp.inf, beside))
    # A waypoint belongs to the motion before it; the first one to that after it.
    begin = jnp.concatenate([points[..., :1], jnp.zeros_like(points[..., 2:])], axis=-1)
    return total + points[..., 1:] + begin + overlap(gap, reach)


def point_distance(
    corner: Float[Array, "_ 2 ..."], x: Float[Array, "2 ..."], gaps: Float[Array, "_ ..."]
) -> Float[Array, "..."]:
    """Distance of points to convex polygons, zero inside; continuously differentiable outside.

    Args:
        corner: Corners of the polygons.
        x: Points.
        gaps: How far the points are beyond each face.
    """
    # By coordinates: with both in one array, XLA's program for several candidates of several fleets writes beyond its
    # memory (jaxlib 0.10.2 on CPUs).
    edge = jnp.roll(corner, -1, axis=0) - corner
    edge_x, edge_y = edge[:, 0], edge[:, 1]
    x_, y_ = x[0][None] - corner[:, 0], x[1][None] - corner[:, 1]
    square = edge_x**2 + edge_y**2
    s = jnp.clip((x_ * edge_x + y_ * edge_y) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
    near = jnp.min((x_ - s * edge_x) ** 2 + (y_ - s * edge_y) ** 2, axis=0)
    return root(jnp.where(jnp.max(gaps, axis=0) > 0, near, 0.0))
