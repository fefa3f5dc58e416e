"""Signed distances between rounded boxes in the plane.

Every shape of the tabletop task is a rounded box: a core rectangle grown by a radius. A disk has a
zero core. All arrays broadcast, so one call measures one pair or every pair of a scene.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_CORNERS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))


def larger(a: Float[Array, "..."], b: Float[Array, "..."] | float) -> Float[Array, "..."]:
    """The larger of two, as a choice: its gradient is that of one of them, in half the kernels of `jnp.maximum`'s."""
    return jnp.where(a > b, a, b)


def smaller(a: Float[Array, "..."], b: Float[Array, "..."] | float) -> Float[Array, "..."]:
    """The smaller of two, likewise."""
    return jnp.where(a < b, a, b)


def size(a: Float[Array, "..."]) -> Float[Array, "..."]:
    """The absolute value, likewise; at zero it has a slope, so that objects in one place part."""
    return jnp.where(a >= 0, a, -a)


class RoundedBox(NamedTuple):
    """Rounded boxes placed in the world; all fields broadcast against each other."""

    x: Float[Array, "..."]  # m, centre
    y: Float[Array, "..."]  # m, centre
    cos: Float[Array, "..."]  # of the heading
    sin: Float[Array, "..."]
    half_x: Float[Array, "..."]  # m, half extents of the core
    half_y: Float[Array, "..."]
    radius: Float[Array, "..."]  # m, how far the core is grown

    def expand(self, axis: int) -> "RoundedBox":
        """The same boxes with a new axis of length one, to measure all pairs by broadcasting."""
        return RoundedBox(*(jnp.expand_dims(field, axis) for field in self))


def in_frame(
    frame: RoundedBox, x: Float[Array, "..."], y: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Points in a box's own frame, m."""
    dx, dy = x - frame.x, y - frame.y
    return frame.cos * dx + frame.sin * dy, frame.cos * dy - frame.sin * dx


def _safe_sqrt(square: Float[Array, "..."], valid: Bool[Array, "..."]) -> Float[Array, "..."]:
    """Square root where `valid`, zero elsewhere, with finite gradients everywhere."""
    return jnp.where(valid, jnp.sqrt(jnp.where(valid, square, 1.0)), 0.0)


def point_distance(
    x: Float[Array, "..."], y: Float[Array, "..."], box: RoundedBox
) -> Float[Array, "..."]:
    """Signed distance of points to rounded boxes, in m; negative inside."""
    u, v = in_frame(box, x, y)
    gap_x, gap_y = size(u) - box.half_x, size(v) - box.half_y
    out_x, out_y = larger(gap_x, 0.0), larger(gap_y, 0.0)
    square = out_x**2 + out_y**2
    inside = smaller(larger(gap_x, gap_y), 0.0)
    return _safe_sqrt(square, square > 0.0) + inside - box.radius


def _one_way(a: RoundedBox, b: RoundedBox) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Least squared distance of b's core vertices to a's core, and the gap along a's two axes."""
    u, v = in_frame(a, b.x, b.y)
    cos = a.cos * b.cos + a.sin * b.sin
    sin = a.cos * b.sin - a.sin * b.cos
    ux, uy = b.half_x * cos, b.half_y * sin
    vx, vy = b.half_x * sin, b.half_y * cos
    squares = []
    for side_x, side_y in _CORNERS:
        out_x = larger(size(u + side_x * ux - side_y * uy) - a.half_x, 0.0)
        out_y = larger(size(v + side_x * vx + side_y * vy) - a.half_y, 0.0)
        squares.append(out_x**2 + out_y**2)
    near = smaller(smaller(squares[0], squares[1]), smaller(squares[2], squares[3]))
    gap_x = size(u) - a.half_x - size(ux) - size(uy)
    gap_y = size(v) - a.half_y - size(vx) - size(vy)
    return near, larger(gap_x, gap_y)


def box_distance(a: RoundedBox, b: RoundedBox) -> Float[Array, "..."]:
    """Signed distance between rounded boxes, in m.

    Separated cores: the exact distance, attained at a vertex of one of them. Overlapping cores: minus
    the depth of penetration along the best separating axis. Then the radii are taken off.
    """
    near_a, gap_a = _one_way(a, b)
    near_b, gap_b = _one_way(b, a)
    near, gap = smaller(near_a, near_b), larger(gap_a, gap_b)
    separated = (gap > 0.0) & (near > 0.0)
    distance = jnp.where(separated, _safe_sqrt(near, separated), smaller(gap, 0.0))
    return distance - a.radius - b.radius


def separating_gap(a: RoundedBox, b: RoundedBox) -> Float[Array, "..."]:
    """Largest gap along the four face normals minus the radii, in m: a cheap lower bound of the distance."""
    (u, v), (p, q) = in_frame(a, b.x, b.y), in_frame(b, a.x, a.y)
    cos = size(a.cos * b.cos + a.sin * b.sin)
    sin = size(a.cos * b.sin - a.sin * b.cos)
    gap_a = larger(
        size(u) - a.half_x - b.half_x * cos - b.half_y * sin,
        size(v) - a.half_y - b.half_x * sin - b.half_y * cos,
    )
    gap_b = larger(
        size(p) - b.half_x - a.half_x * cos - a.half_y * sin,
        size(q) - b.half_y - a.half_x * sin - a.half_y * cos,
    )
    return larger(gap_a, gap_b) - a.radius - b.radius


def wall_margins(
    box: RoundedBox, half_width: Float[Array, "..."], half_depth: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """How far a box stays inside the table along x and along y, in m; negative where it sticks out."""
    reach_x = box.half_x * size(box.cos) + box.half_y * size(box.sin) + box.radius
    reach_y = box.half_x * size(box.sin) + box.half_y * size(box.cos) + box.radius
    return half_width - size(box.x) - reach_x, half_depth - size(box.y) - reach_y
