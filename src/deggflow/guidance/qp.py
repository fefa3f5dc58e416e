"""The local QP of one agent: the smallest input that meets its rows.

In the metric's own coordinates the QP is the projection of the origin onto a polyhedron. Up to two rows are
solved in closed form; more row by row where there are few inputs, else by a dual active-set method. Each ends after
finitely many steps with the exact solution or with the proof that there is none.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Bool, Float

from .active_set import project_origin, resolution
from .row_by_row import MAX_INPUTS, MAX_ROWS, project_row_by_row


class MinNormInput(NamedTuple):
    """Result of `min_norm_input`; where infeasible, `u` meets what rows it can."""

    u: Float[Array, " inputs"]
    feasible: Bool[Array, ""]


def min_norm_input(
    ell: Float[Array, "rows inputs"],
    b: Float[Array, " rows"],
    metric: Float[Array, "inputs inputs"] | None = None,
    *,
    box: float | None = None,
    norm: float | None = None,
) -> MinNormInput:
    """Minimises `u @ metric @ u` subject to `ell @ u + b <= 0`, exactly.

    A row that no input can change (`ell = 0`) with `b > 0` is infeasible, and left out of `u`.

    Args:
        ell: One row per requirement, requirement units per input unit.
        b: Offset of each half-space; positive where the agent must act.
        metric: H, symmetric positive definite; the identity if None.
        box: Largest size of each entry of the input; no limit if None.
        norm: Largest `sqrt(u @ metric @ u)`; no limit if None. Where the rows ask for more, the input is
            scaled down to the limit and reported as infeasible.

    Returns:
        The input, and whether all rows and limits can be met.

    Raises:
        ValueError: A limit is not positive.

    Source: paper, eqn:SE_local_QP and eqn:PE_local_qp_general; row by row after Seidel (1991), dual active set
    after Goldfarb and Idnani (1983).
    """
    check_limits(box, norm)
    inputs = ell.shape[1]
    if box is not None:
        eye = jnp.eye(inputs, dtype=ell.dtype)
        ell = jnp.concatenate([ell, eye, -eye])
        b = jnp.concatenate([b, jnp.full(2 * inputs, -box, b.dtype)])
    if ell.shape[0] == 0:
        return MinNormInput(jnp.zeros(inputs, ell.dtype), jnp.asarray(True))
    root = None if metric is None else jnp.linalg.cholesky(metric)
    # H = L L^T and v = L^T u: in v the metric is the identity, and a row reads (L^-1 ell) . v + b <= 0.
    rows = ell if root is None else solve_triangular(root, ell.T, lower=True).T
    square = jnp.sum(rows**2, axis=-1)
    live = square > jnp.finfo(ell.dtype).tiny
    length = jnp.sqrt(jnp.where(live, square, 1.0))
    unit = jnp.where(live, 1.0 / length, 0.0)[:, None] * rows
    distance = jnp.where(live, b / length, 0.0)
    v, found = _project(unit, distance)
    feasible = found & jnp.all(live | (b <= 0))
    u = v if root is None else solve_triangular(root, v, lower=True, trans="T")
    if box is not None:
        u = jnp.clip(u, -box, box)
    if norm is not None:
        size = jnp.sqrt(jnp.sum((u if root is None else u @ root) ** 2))
        feasible &= size <= norm
        u = u * jnp.minimum(1.0, norm / jnp.maximum(size, norm))
    return MinNormInput(u, feasible)


def check_limits(box: float | None, norm: float | None) -> None:
    """Raises `ValueError` for a limit that is not positive."""
    for name, limit in (("box", box), ("norm", norm)):
        if limit is not None and not limit > 0:
            raise ValueError(f"`{name}` must be positive, as it limits a size; got {limit}.")


def _project(
    unit: Float[Array, "rows inputs"], distance: Float[Array, " rows"]
) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
    """The point nearest to the origin with `unit @ v + distance <= 0`; rows of zeros count for nothing."""
    if unit.shape[0] == 1:
        return -jnp.maximum(distance[0], 0.0) * unit[0], jnp.asarray(True)
    if unit.shape[0] == 2:
        return _project_two(unit, distance)
    if unit.shape[0] <= MAX_ROWS and unit.shape[1] <= MAX_INPUTS:
        return project_row_by_row(unit, distance)
    return project_origin(unit, distance, resolution(unit.dtype))


def _project_two(
    unit: Float[Array, "2 inputs"], distance: Float[Array, " 2"]
) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
    """Active sets {}, {0}, {1}, {0, 1} in turn."""
    first, second = distance[0], distance[1]
    overlap = unit[0] @ unit[1]
    one = jnp.maximum(distance, 0.0)
    rounding = 8 * jnp.finfo(unit.dtype).eps * (jnp.abs(first) + jnp.abs(second))
    only_first = second - overlap * one[0] <= rounding  # row 0 alone (or none) also meets row 1
    only_second = first - overlap * one[1] <= rounding
    # The part of row 1 across row 0, twice: 1 - overlap^2 would have no digits left for nearly parallel rows.
    across = unit[1] - overlap * unit[0]
    across = across - (across @ unit[0]) * unit[0]
    square = jnp.sum(across**2)
    crossing = square > resolution(unit.dtype) ** 2
    sine = jnp.sqrt(jnp.where(crossing, square, 1.0))
    both = -first * unit[0] - ((second - overlap * first) / sine) * (across / sine)
    # Opposed rows that cross nowhere: half of each, and said to be infeasible.
    neither = -(one[0] * unit[0] + one[1] * unit[1]) / 2
    # Where either would do, rows agree up to rounding: the larger one is needed, and the smaller one idle.
    use_first = only_first & (~only_second | (one[0] >= one[1]))
    alone = -jnp.where(use_first, one[0] * unit[0], one[1] * unit[1])
    v = jnp.where(only_first | only_second, alone, jnp.where(crossing, both, neither))
    return v, only_first | only_second | crossing
