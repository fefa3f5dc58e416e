"""Violations of pairs of rounded boxes, and of boxes at walls, that guidance can descend: without convex kinks.

The distance of two boxes is a least one over vertices, and half the square of its hinge has a convex kink where two
vertices are as near, as between parallel faces: descent slides along it, and V rises along a feasible trajectory. Here
the squares of all vertices' hinges are summed. The kinks that remain are concave, from least values of several smooth
functions: at these the slope of either serves (docs/theory.md, section 2).

An obstacle between an object and its regions is pushed back and forth by these sums and stays. `caught_violation` leads it out.
"""

from collections.abc import Iterator

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .geometry import RoundedBox, in_frame, larger, size, smaller

TOUCHING = 1e-12  # m^2, floor of squared distances: the slope of a root has no bound at zero
CAUGHT = 0.03  # m, of which the squared hinge at a region is a half where V of a caught obstacle has half its weight
DIAGONAL = (
    0.5**0.5
)  # a gap along the best of two boxes' axes is at least that part of their distance

Offset = tuple[Float[Array, "..."], Float[Array, "..."]]


def _vertices(
    box: RoundedBox, cos: Float[Array, "..."], sin: Float[Array, "..."]
) -> Iterator[Offset]:
    """From the centre of a box with this heading to its vertices, m."""
    ux, uy = box.half_x * cos, box.half_y * sin
    vx, vy = box.half_x * sin, box.half_y * cos
    for x, y in ((ux - uy, vx + vy), (ux + uy, vx - vy)):
        yield x, y
        yield -x, -y


def _is_point(box: RoundedBox) -> Bool[Array, "..."]:
    return (box.half_x <= 0) & (box.half_y <= 0)


def _square(hinge: Float[Array, "..."]) -> Float[Array, "..."]:
    return larger(hinge, 0.0) ** 2


def _one_way(
    a: RoundedBox, b: RoundedBox, reach: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Sums over b's vertices of the squared hinges of distances to a's core, and of gaps along the better of a's axes."""
    u, v = in_frame(a, b.x, b.y)
    cos = a.cos * b.cos + a.sin * b.sin
    sin = a.cos * b.sin - a.sin * b.cos
    deep_x = DIAGONAL * reach + a.half_x - size(u)
    deep_y = DIAGONAL * reach + a.half_y - size(v)
    near, along_x, along_y = jnp.zeros(()), jnp.zeros(()), jnp.zeros(())
    for x, y in _vertices(b, cos, sin):
        out_x = larger(size(u + x) - a.half_x, 0.0)
        out_y = larger(size(v + y) - a.half_y, 0.0)
        near += _square(reach - jnp.sqrt(larger(out_x**2 + out_y**2, TOUCHING)))
        # Opposite vertices have opposite offsets: the sum is the same on both sides of a.
        along_x += _square(deep_x - x)
        along_y += _square(deep_y - y)
    return near, smaller(along_x, along_y)


def box_violation(a: RoundedBox, b: RoundedBox, buffer: float) -> Float[Array, "..."]:
    """V of two rounded boxes, in m^2: at least max(buffer - distance, 0)^2 / 2, and zero where that is zero.

    Vertices' distances to the other core, and where cores overlap, which two boxes may without a vertex inside, the
    depth along the best axis. A point has one vertex, not four, and no axes.
    """
    reach = a.radius + b.radius + buffer
    near_a, along_a = _one_way(a, b, reach)
    near_b, along_b = _one_way(b, a, reach)
    point_a, point_b = _is_point(a), _is_point(b)
    near, along = near_a + near_b, smaller(along_a, along_b)
    near = jnp.where(point_b, near_a / 4, jnp.where(point_a, near_b / 4, near))
    along = jnp.where(point_b, along_a / 4, jnp.where(point_a, along_b / 4, along))
    return near / 2 + jnp.where(point_a & point_b, 0.0, along)


def wall_violation(
    box: RoundedBox,
    half_width: Float[Array, "..."],
    half_depth: Float[Array, "..."],
    buffer: float,
) -> Float[Array, "..."]:
    """V of a rounded box at the table's edges, in m^2: at least that of its two margins, and zero where that is zero."""
    room_x, room_y = half_width - box.radius - buffer, half_depth - box.radius - buffer
    total = jnp.zeros(())
    for x, y in _vertices(box, box.cos, box.sin):
        total += _square(size(box.x + x) - room_x) + _square(size(box.y + y) - room_y)
    return jnp.where(_is_point(box), total / 8, total / 2)


def hinge_violation(margin: Float[Array, "..."], buffer: float) -> Float[Array, "..."]:
    """V of a margin without convex kinks, in m^2, such as a point's: max(buffer - margin, 0)^2 / 2."""
    return _square(buffer - margin) / 2


def caught_violation(
    strip: RoundedBox, obstacle: RoundedBox, blocked: Float[Array, "..."], buffer: float
) -> Float[Array, "..."]:
    """V of an obstacle on the strip from an object out over its regions, in m^2: zero where `blocked` is zero.

    It falls as the obstacle moves off the strip, to either side or beyond its end, whichever is nearest; that of a region
    alone may push it back to the object.

    Args:
        strip: Centre of the row of regions, heading outward, `half_y` of the row to either side and the regions' radius.
        obstacle: Any rounded box.
        blocked: V of a region of the strip for this obstacle, in m^2.
        buffer: Of the margins, in m.
    """
    u, v = in_frame(strip, obstacle.x, obstacle.y)
    cos = strip.cos * obstacle.cos + strip.sin * obstacle.sin
    sin = strip.cos * obstacle.sin - strip.sin * obstacle.cos
    reach = strip.radius + obstacle.radius + buffer
    beyond, aside = jnp.zeros(()), jnp.zeros(())
    for x, y in _vertices(obstacle, cos, sin):
        beyond += _square(reach - u - x)
        aside += _square(strip.half_y + reach - size(v) - y)
    return blocked / (blocked + CAUGHT**2) * smaller(beyond, aside) / 8
