"""The QP of barrier methods: the smallest input under many rows with slack variables."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance.active_set import project_origin, resolution


def relaxed_input(
    ell: Float[Array, "constraints inputs"],
    b: Float[Array, " constraints"],
    *,
    rows: int,
    slack: float,
) -> Float[Array, " inputs"]:
    """Minimises `u @ u + slack * s @ s` subject to `ell @ u + b <= s`.

    With a slack for every row, the QP always has a solution. A single active row is relaxed by the fraction
    1 / (1 + slack |ell|^2) of b. Only the `rows` constraints that are most violated at u = 0 are included. Any other
    constraint, at the distance d < 0, stays satisfied as long as |u| <= -d.

    Args:
        ell: One row per constraint; rows of zeros are ignored.
        b: Offsets, positive where the input must act.
        rows: Number of constraints that are included; static.
        slack: Weight of the slack variables.

    Returns:
        The input u.
    """
    length = jnp.sqrt(jnp.sum(ell**2, axis=-1))
    nonzero = length > 0
    distance = jnp.where(nonzero, b / jnp.where(nonzero, length, 1.0), -jnp.inf)
    count = min(rows, ell.shape[0])
    worst, index = jax.lax.top_k(distance, count)
    finite = jnp.isfinite(worst)
    wide = jnp.concatenate([ell[index], -jnp.eye(count, dtype=ell.dtype) / slack**0.5], axis=1)
    size = jnp.sqrt(length[index] ** 2 + 1 / slack)
    unit = jnp.where(finite[:, None], wide / size[:, None], 0.0)
    offset = jnp.where(finite, b[index] / size, 0.0)
    v, _ = project_origin(unit, offset, resolution(ell.dtype))
    return v[: ell.shape[1]]
