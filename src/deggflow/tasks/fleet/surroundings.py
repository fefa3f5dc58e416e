"""Signed distance to the nearest obstacle or bound, and the direction away from it, at many points at once."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .condition import FleetArrays

BLEND = 0.02  # map units, difference in distance over which directions of two obstacles blend
_TINY = 1e-9

Points = Float[Array, " points"]
Rows = Float[Array, "obstacles points"]


def _vector(x: Rows, y: Rows) -> tuple[Rows, Rows, Rows]:
    """Length and direction, with a finite gradient at zero."""
    length = jnp.sqrt(x**2 + y**2 + _TINY)
    return length, x / length, y / length


def _solids(x: Points, y: Points, solids: Float[Array, "solids 5"]) -> tuple[Rows, Rows, Rows]:
    cx, cy, half_x, half_y, radius = (solids[:, k, None] for k in range(5))
    dx, dy = x[None] - cx, y[None] - cy
    qx, qy = jnp.abs(dx) - half_x, jnp.abs(dy) - half_y
    side_x, side_y = jnp.where(dx < 0, -1.0, 1.0), jnp.where(dy < 0, -1.0, 1.0)
    length, along_x, along_y = _vector(jnp.maximum(qx, 0.0), jnp.maximum(qy, 0.0))
    deep = jnp.maximum(qx, qy)
    inside, by_x = deep < 0, qx > qy
    return (
        jnp.where(inside, deep, length) - radius,
        side_x * jnp.where(inside, by_x, along_x),
        side_y * jnp.where(inside, ~by_x, along_y),
    )


def _triangles(
    x: Points, y: Points, triangles: Float[Array, "triangles 3 2"]
) -> tuple[Rows, Rows, Rows]:
    rows, inside = [], jnp.ones((triangles.shape[0], x.shape[0]), bool)
    for k in range(3):
        corner, edge = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        dx, dy = x[None] - corner[:, 0, None], y[None] - corner[:, 1, None]
        ex, ey = edge[:, 0, None], edge[:, 1, None]
        share = jnp.clip((dx * ex + dy * ey) / (ex**2 + ey**2), 0.0, 1.0)
        rows.append(_vector(dx - share * ex, dy - share * ey))
        inside = inside & (ex * dy - ey * dx > 0)  # counter-clockwise
    length = jnp.stack([row[0] for row in rows])
    nearest = jax.nn.one_hot(jnp.argmin(length, axis=0), 3, axis=0)
    sign = jnp.where(inside, -1.0, 1.0)
    along_x, along_y = (
        sign * jnp.sum(nearest * jnp.stack([row[k] for row in rows]), axis=0) for k in (1, 2)
    )
    return sign * jnp.min(length, axis=0), along_x, along_y


def _bounds(x: Points, y: Points, bounds: Float[Array, " 4"]) -> tuple[Rows, Rows, Rows]:
    left, low, right, high = bounds
    distance = jnp.stack([x - left, right - x, y - low, high - y])
    one = jnp.ones_like(x)
    return (
        distance,
        jnp.stack([one, -one, 0 * one, 0 * one]),
        jnp.stack([0 * one, 0 * one, one, -one]),
    )


def surroundings(x: Points, y: Points, condition: FleetArrays) -> tuple[Points, Points, Points]:
    """Signed distance of points to what is nearest, and the direction (x, y) away from it.

    Where two obstacles are about as near, their directions blend within `BLEND`.
    """
    families = [_bounds(x, y, condition.bounds)]
    if condition.solids.shape[0]:
        families.append(_solids(x, y, condition.solids))
    if condition.triangles.shape[0]:
        families.append(_triangles(x, y, condition.triangles))
    distance, along_x, along_y = (
        jnp.concatenate([family[k] for family in families]) for k in range(3)
    )
    least = jnp.min(distance, axis=0)
    share = jnp.exp((least[None] - distance) / BLEND)
    share = share / jnp.sum(share, axis=0, keepdims=True)
    return least, jnp.sum(share * along_x, axis=0), jnp.sum(share * along_y, axis=0)
