"""Lists of pairs of a scene's parts, each pair once: what belongs to their first and second parts, and sums back.

Both are products with constant matrices of zeros and ones. Written as broadcasts, the gradient of all pairs would have
sums that XLA's CPU backend fuses with all they sum, number by number.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


class Pairs(NamedTuple):
    """Pairs of a first part of one list and a second part of another, or of the same."""

    first: Int[np.ndarray, " pairs"]
    second: Int[np.ndarray, " pairs"]


def within(parts: int) -> Pairs:
    """Every two of a list of parts."""
    return Pairs(*np.triu_indices(parts, 1))


def between(first: int, second: int) -> Pairs:
    """Each part of a list with each of another."""
    return Pairs(*(index.ravel() for index in np.indices((first, second))))


def pick(
    index: Int[np.ndarray, " pairs"], parts: Float[Array, "parts *samples"]
) -> Float[Array, "pairs *samples"]:
    """`parts[index]` of finite numbers; one that is not makes a sample's pairs not a number, all of them."""
    return _product(np.eye(len(parts))[index], parts)


def total(
    index: Int[np.ndarray, " pairs"], pairs: Float[Array, "pairs *samples"], parts: int
) -> Float[Array, "parts *samples"]:
    """Sum over the pairs whose `index` is each of so many parts."""
    return _product(np.eye(parts)[:, index], pairs)


def _product(
    matrix: Float[np.ndarray, "rows columns"], values: Float[Array, "columns *samples"]
) -> Float[Array, "rows *samples"]:
    ones, exactly = jnp.asarray(matrix, values.dtype), jax.lax.Precision.HIGHEST  # on every device
    return jnp.tensordot(ones, values, 1, precision=exactly)
