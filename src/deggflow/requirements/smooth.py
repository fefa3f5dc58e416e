"""Smooth minima and maxima with sound bounds: never above what they stand for, and below it by at most a width."""

import math

import jax.numpy as jnp
from jax.nn import logsumexp
from jaxtyping import Array, Float


def minimum_below(values: Float[Array, "..."], width: float, axis: int) -> Float[Array, "..."]:
    """A smooth function of the values, at most their minimum and at least `minimum - width`.

    Example:
        >>> float(minimum_below(jnp.array([1.0, 2.0]), 0.1, axis=0)) <= 1.0
        True
    """
    return -_maximum_above(-values, width, axis)


def maximum_below(values: Float[Array, "..."], width: float, axis: int) -> Float[Array, "..."]:
    """A smooth function of the values, at most their maximum and at least `maximum - width`.

    Example:
        >>> float(maximum_below(jnp.array([1.0, 2.0]), 0.1, axis=0)) <= 2.0
        True
    """
    excess = width if values.shape[axis] > 1 else 0.0
    return _maximum_above(values, width, axis) - excess


def _maximum_above(values: Float[Array, "..."], width: float, axis: int) -> Float[Array, "..."]:
    """A smooth function of the values, at least their maximum and at most `maximum + width`."""
    count = values.shape[axis]
    if count == 1:
        return jnp.squeeze(values, axis)
    if width == 0:
        return jnp.max(values, axis)
    sharpness = math.log(count) / width
    return logsumexp(sharpness * values, axis=axis) / sharpness
