"""The local QP of one agent: the smallest input that meets its rows."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

PARALLEL = 1e-6  # squared sine of the angle between two rows below which they count as parallel


class MinNormInput(NamedTuple):
    """Result of `min_norm_input`; where infeasible, `u` meets as many single rows as it can."""

    u: Float[Array, " inputs"]
    feasible: Bool[Array, ""]


def min_norm_input(
    ell: Float[Array, "rows inputs"],
    b: Float[Array, " rows"],
    metric: Float[Array, "inputs inputs"] | None = None,
) -> MinNormInput:
    """Minimises `u @ metric @ u` subject to `ell @ u + b <= 0`, in closed form for up to two rows.

    A row that no input can change (`ell = 0`) with `b > 0` is infeasible, and left out of `u`.

    Args:
        ell: One row per requirement, requirement units per input unit.
        b: Offset of each half-space; positive where the agent must act.
        metric: H, symmetric positive definite; the identity if None.

    Returns:
        The input, and whether all rows can be met.

    Raises:
        ValueError: More than two rows.

    Source: paper, eqn:SE_local_QP and eqn:PE_local_qp_general.
    """
    rows, inputs = ell.shape
    if rows > 2:
        raise ValueError(
            f"`ell` has {rows} rows; the closed form covers two at most (paper, prop:c2_feasibility)."
        )
    if rows == 0:
        return MinNormInput(jnp.zeros(inputs), jnp.asarray(True))
    lift = ell if metric is None else jnp.linalg.solve(metric, ell.T).T  # H^-1 ell of each row
    square = jnp.sum(ell * lift, axis=-1)
    tiny = jnp.finfo(ell.dtype).tiny
    live = square > tiny
    norm = jnp.sqrt(jnp.where(live, square, 1.0))
    # Unit rows in the metric of H: s is how far along a row the input must go.
    direction = jnp.where(live, 1.0 / norm, 0.0)[:, None] * lift
    distance = jnp.where(live, b / norm, 0.0)
    met = jnp.all(live | (b <= 0))
    if rows == 1:
        return MinNormInput(-jnp.maximum(distance[0], 0.0) * direction[0], met)
    overlap = jnp.where(live[0] & live[1], ell[0] @ lift[1] / (norm[0] * norm[1]), 0.0)
    return _two_rows(direction, distance, overlap, met)


def _two_rows(
    direction: Float[Array, "2 inputs"],
    distance: Float[Array, " 2"],
    overlap: Float[Array, ""],
    met: Bool[Array, ""],
) -> MinNormInput:
    """Active sets {}, {0}, {1}, {0, 1} of two unit rows in turn; `overlap` is the cosine between them."""
    first, second = distance[0], distance[1]
    one = jnp.maximum(distance, 0.0)
    only_first = second - overlap * one[0] <= 0  # row 0 alone (or none) also meets row 1
    only_second = first - overlap * one[1] <= 0
    sine2 = 1 - overlap**2
    crossing = sine2 > PARALLEL
    denominator = jnp.where(crossing, sine2, 1.0)
    both_0 = (first - overlap * second) / denominator
    both_1 = (second - overlap * first) / denominator
    # Opposed rows that cross nowhere: half of each, and said to be infeasible.
    both_0 = jnp.where(crossing, both_0, one[0] / 2)
    both_1 = jnp.where(crossing, both_1, one[1] / 2)
    alone = only_first | only_second
    use_first = only_first & (~only_second | (one[0] <= one[1]))
    weight_0 = jnp.where(alone, jnp.where(use_first, one[0], 0.0), both_0)
    weight_1 = jnp.where(alone, jnp.where(use_first, 0.0, one[1]), both_1)
    u = -(weight_0 * direction[0] + weight_1 * direction[1])
    return MinNormInput(u, met & (alone | crossing))
