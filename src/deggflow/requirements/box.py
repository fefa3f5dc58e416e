"""Repulsion from boxes around the origin: hinges over distances that are continuously differentiable outside of them."""

from collections.abc import Sequence
from functools import reduce
from itertools import combinations
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .term import dot, hinge, root

Local = Float[Array, "axes regions agents waypoints"]
Half = Float[Array, "axes regions #agents #waypoints"]
Each = Float[Array, "regions agents waypoints"]


def overlap(gap: Float[Array, "..."], reach: Any) -> Float[Array, "..."]:
    """What is added where shapes overlap by -gap: hinge(reach - gap) less its value at contact."""
    deep = jnp.where(gap < 0, -gap, 0.0)
    return deep**2 / 2 + reach * deep


def _size(a: Float[Array, "..."]) -> Float[Array, "..."]:
    """The absolute value; at zero it has a slope, so that a point in the middle of a box can leave it."""
    return jnp.where(a >= 0, a, -a)


def point_repulsion(point: Local, half: Half, reach: Any) -> Each:
    """Of points."""
    gap = [_size(x) - h for x, h in zip(point, half, strict=True)]
    return hinge(reach - root(_beyond(gap))) + overlap(reduce(_larger, gap), reach)


def segment_repulsion(first: Local, last: Local, half: Half, reach: Any, eps: float) -> Each:
    """Of straight segments, by distances that are at most `eps` smaller than the exact ones.

    The squared distance of `first + s way` is convex in s, its slope piecewise linear with breaks where a coordinate
    passes a face. With (2 eps)^2 (s - 1/2)^2 added, the least value is at one s, which is held fixed (Danskin).
    """
    way, weight = last - first, 4 * eps**2
    s = jax.lax.stop_gradient(_minimiser(first, way, half, weight))
    gap = [_size(x + s * w) - h for x, w, h in zip(first, way, half, strict=True)]
    near = root(_beyond(gap) + weight * (s - 0.5) ** 2) - eps
    return hinge(reach - near) + overlap(_parting(first, last, half), reach)


def _beyond(gap: Sequence[Each]) -> Each:
    """Squared distance from a box, from what the coordinates lie beyond its faces."""
    # Axis by axis, here and below: XLA's CPU backend would compute what arrays of all axes are made of again and again.
    return reduce(jnp.add, [jnp.where(each > 0, each, 0.0) ** 2 for each in gap])


def _minimiser(first: Local, way: Local, half: Half, weight: float) -> Each:
    """Root in [0, 1] of the slope, between the nearest of its breaks on either side."""

    def slope(s: Each) -> Each:
        point = first + s[None] * way
        over = point - jnp.clip(point, -half, half)
        return dot(over, way) + weight * (s - 0.5)

    low, high = jnp.zeros_like(first[0]), jnp.ones_like(first[0])
    at_low, at_high = slope(low), slope(high)
    moving = way != 0
    for side in (-1.0, 1.0):
        breaks = (side * half - first) / jnp.where(moving, way, 1.0)
        for s in jnp.clip(jnp.where(moving, breaks, 0.0), 0.0, 1.0):
            here = slope(s)
            below, above = (here <= 0) & (s > low), (here >= 0) & (s < high)
            low, at_low = jnp.where(below, s, low), jnp.where(below, here, at_low)
            high, at_high = jnp.where(above, s, high), jnp.where(above, here, at_high)
    rise = at_high - at_low
    part = jnp.where(rise > 0, -at_low / jnp.where(rise > 0, rise, 1.0), 0.0)
    return low + jnp.clip(part, 0.0, 1.0) * (high - low)


def _parting(first: Local, last: Local, half: Half) -> Each:
    """Largest gap along the axes that can part a segment from a box, negative where they overlap."""
    axes = range(len(first))
    middle, way = (first + last) / 2, last - first
    # Of the segment and the box together, along each axis.
    gap = reduce(_larger, [_size(middle[k]) - _size(way[k]) / 2 - half[k] for k in axes])
    for i, j in combinations(axes, 2):
        # Normal to the segment and, in space, to the axis that is neither i nor j.
        square = way[i] ** 2 + way[j] ** 2
        still = square == 0
        size = jnp.sqrt(jnp.where(still, 1.0, square))
        across = _size(way[i] * first[j] - way[j] * first[i])
        reach = _size(way[i]) * half[j] + _size(way[j]) * half[i]
        gap = _larger(gap, jnp.where(still, -jnp.inf, (across - reach) / size))
    return gap


def _larger(a: Each, b: Each) -> Each:
    # A choice, not `jnp.maximum`, whose gradient is split at ties: fewer kernels.
    return jnp.where(a >= b, a, b)
