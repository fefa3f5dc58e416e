"""The QP of barrier methods: the smallest input under many rows, which may give way a little."""

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

    With a slack for every row the QP always has a solution; a row alone gives way by the share 1 / (1 + slack |ell|^2).
    Only the `rows` constraints that are furthest from holding at u = 0 are looked at. Any other one, at the distance
    d < 0, stays satisfied as long as |u| <= -d.

    Args:
        ell: One row per constraint; rows of zeros count for nothing.
        b: Positive where the input must act.
        rows: How many constraints are looked at; static.
        slack: Weight of the slack variables.
    """
    length = jnp.sqrt(jnp.sum(ell**2, axis=-1))
    live = length > 0
    distance = jnp.where(live, b / jnp.where(live, length, 1.0), -jnp.inf)
    count = min(rows, ell.shape[0])
    worst, index = jax.lax.top_k(distance, count)
    used = jnp.isfinite(worst)
    wide = jnp.concatenate([ell[index], -jnp.eye(count, dtype=ell.dtype) / slack**0.5], axis=1)
    size = jnp.sqrt(length[index] ** 2 + 1 / slack)
    unit = jnp.where(used[:, None], wide / size[:, None], 0.0)
    away = jnp.where(used, b[index] / size, 0.0)
    v, _ = project_origin(unit, away, resolution(ell.dtype))
    return v[: ell.shape[1]]
