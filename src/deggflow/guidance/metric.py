"""The metric H of inputs: what it must be, and its factor H = L L^T, with which a QP's rows are mapped.

For few inputs all of it is written out, entry by entry: a call of LAPACK takes longer for one matrix of three rows than a
whole QP.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from .active_set import FEW

ASYMMETRY = (
    1e-5  # relative; the metric is made symmetric, so that what rounding left there does no harm
)

Matrix = Float[Array, "inputs inputs"]
Vectors = Float[Array, "*rows inputs"]


def factor(metric: Matrix) -> Matrix:
    """L, lower triangular, with L L^T = H; not a number where H is not positive definite."""
    inputs = len(metric)
    if inputs > FEW:
        return jnp.linalg.cholesky(metric)
    symmetric = (metric + metric.T) / 2
    entries = [[jnp.zeros((), metric.dtype)] * inputs for _ in range(inputs)]
    for j in range(inputs):
        for i in range(j, inputs):
            rest = symmetric[i, j] - sum(entries[i][k] * entries[j][k] for k in range(j))
            entries[i][j] = jnp.sqrt(rest) if i == j else rest / entries[j][j]
    return jnp.stack([jnp.stack(row) for row in entries])


def below(root: Matrix, rows: Vectors) -> Vectors:
    """L^-1 of every row."""
    inputs = len(root)
    if inputs > FEW:
        return solve_triangular(root, rows.T, lower=True).T
    entries: list[Array] = []
    for i in range(inputs):
        rest = rows[..., i] - sum(root[i, k] * entries[k] for k in range(i))
        entries.append(rest / root[i, i])
    return jnp.stack(entries, axis=-1)


def above(root: Matrix, vector: Float[Array, " inputs"]) -> Float[Array, " inputs"]:
    """L^-T of a vector."""
    inputs = len(root)
    if inputs > FEW:
        return solve_triangular(root, vector, lower=True, trans="T")
    entries: list[Array] = [vector[0]] * inputs
    for i in reversed(range(inputs)):
        rest = vector[i] - sum(root[k, i] * entries[k] for k in range(i + 1, inputs))
        entries[i] = rest / root[i, i]
    return jnp.stack(entries)


def check_metric(metric: Any, inputs: int | None = None) -> None:
    """Raises `TypeError` or `ValueError` unless a metric is symmetric and positive definite.

    Args:
        metric: One matrix for all agents, one for each of them, or None. Values that are not known yet (inside a
            compiled program) are not looked at.
        inputs: How many rows each matrix must have; any number if None.
    """
    if metric is None:
        return
    shape, kind = getattr(metric, "shape", None), getattr(metric, "dtype", None)
    if shape is None or kind is None:
        raise TypeError(
            "`metric` must be an array, a symmetric positive definite matrix for all agents or one per agent; "
            f"got {type(metric).__name__}."
        )
    size = "inputs" if inputs is None else inputs
    square = len(shape) in (2, 3) and shape[-1] == shape[-2] and shape[-1] > 0
    if not square or (inputs is not None and shape[-1] != inputs):
        raise ValueError(
            f"`metric` must have shape ({size}, {size}), or (agents, {size}, {size}) with one matrix per agent; "
            f"got {tuple(shape)}."
        )
    if not jnp.issubdtype(kind, jnp.floating):
        raise TypeError(f"`metric` must hold floating-point numbers; got {kind}.")
    if isinstance(metric, jax.core.Tracer):
        return
    precision = float(jnp.finfo(jax.dtypes.canonicalize_dtype(kind)).eps)
    values = np.asarray(metric, np.float64)
    for agent, matrix in enumerate(values.reshape(-1, *shape[-2:])):
        whose = "`metric`" if len(shape) == 2 else f"`metric` of agent {agent}"
        if not np.isfinite(matrix).all():
            raise ValueError(f"{whose} must be finite; got {matrix.tolist()}.")
        diagonal = np.diagonal(matrix)
        if not (diagonal > 0).all():
            raise ValueError(
                f"{whose} must be positive definite; got {diagonal.min():g} on its diagonal."
            )
        # Inputs may have different units: each is measured by its own entry on the diagonal.
        unit = np.sqrt(diagonal)
        unit_diagonal = matrix / unit / unit[:, None]
        apart = np.abs(unit_diagonal - unit_diagonal.T)
        if apart.max() > ASYMMETRY:
            j, k = np.unravel_index(apart.argmax(), apart.shape)
            raise ValueError(
                f"{whose} must be symmetric; got {matrix[j, k]:g} at ({j}, {k}) and {matrix[k, j]:g} at ({k}, {j})."
            )
        if not np.linalg.eigvalsh(unit_diagonal + unit_diagonal.T)[0] / 2 > len(matrix) * precision:
            least = np.linalg.eigvalsh(matrix + matrix.T)[0] / 2
            raise ValueError(
                f"{whose} must be positive definite; got a matrix whose least eigenvalue is {least:g}."
            )
