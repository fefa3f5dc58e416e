"""The local QP of one agent: the smallest input that meets its rows.

In the metric's own coordinates the QP is the projection of the origin onto a polyhedron. Up to two rows are
solved in closed form; more row by row where there are few inputs, else by a dual active-set method. Each ends after
finitely many steps with the exact solution or with the proof that there is none. What rounding left is solved for
once more, and in the end every row is looked at again, at its own scale.
"""

from functools import partial, reduce
from numbers import Real
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .active_set import FEW, crossing, dot, largest, project_origin, square
from .metric import above, below, check_metric, factor
from .row_by_row import MAX_INPUTS, MAX_ROWS, project_row_by_row

ROUNDING = 8  # times the precision and the size of what is added up: what a sum of a few products may be off
PASSES = 8  # each brings rows down that are 1 / precision smaller than those before


class MinNormInput(NamedTuple):
    """Result of `min_norm_input`; where infeasible, `u` is finite and meets what rows it can."""

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

    Rows may be of any scale: nothing depends on the unit of a requirement or of the input. "Feasible" says that
    `u` meets every row up to 16 times the precision of `|ell| |u| + |b|`, each row by its own `ell` and `b`.

    A row that no input can change (`ell = 0`) with `b > 0` is infeasible, and left out of `u`. So is a row that is
    not a number, and one that asks for an input too large to be represented. `b = -inf` asks for nothing.

    Args:
        ell: One row per requirement, requirement units per input unit.
        b: Offset of each half-space; positive where the agent must act.
        metric: H, symmetric positive definite; the identity if None. Rows whose directions it brings together up to
            rounding cannot be told apart, and may be called infeasible.
        box: Largest size of each entry of the input; no limit if None.
        norm: Largest `sqrt(u @ metric @ u)`; no limit if None. Where the rows ask for more, the input is
            scaled down to the limit and reported as infeasible.

    Returns:
        The input, and whether all rows and limits are met.

    Raises:
        TypeError: An argument is not of floating-point numbers.
        ValueError: A shape does not fit, a limit is not positive, or a metric is not symmetric positive definite.

    Source: paper, eqn:SE_local_QP and eqn:PE_local_qp_general; row by row after Seidel (1991), dual active set
    after Goldfarb and Idnani (1983).
    """
    _check_rows(ell, b, metric)
    check_limits(box, norm)
    with jax.default_matmul_precision("highest"):
        return _min_norm_input(
            ell,
            b,
            metric,
            None if box is None else float(box),
            None if norm is None else float(norm),
        )


# Compiled by itself, so that a call outside a compiled program does not trace its loops anew; else a part of that program.
@partial(jax.jit, static_argnums=(3, 4), inline=True)
def _min_norm_input(
    ell: Float[Array, "rows inputs"],
    b: Float[Array, " rows"],
    metric: Float[Array, "inputs inputs"] | None,
    box: float | None,
    norm: float | None,
) -> MinNormInput:
    count, inputs = ell.shape
    if count == 0:
        return MinNormInput(jnp.zeros(inputs, ell.dtype), jnp.asarray(True))
    rows, offset, well = _unit_rows(ell, b)
    if metric is None and box is None and norm is None and count <= 2:
        u, feasible = _project(rows, offset)
        return MinNormInput(u, well & feasible)
    if box is not None:
        eye = jnp.eye(inputs, dtype=ell.dtype)
        rows = jnp.concatenate([rows, eye, -eye])
        offset = jnp.concatenate([offset, jnp.full(2 * inputs, -box, ell.dtype)])
    problem = _in_metric(rows, offset, metric)
    u, feasible = _solved(problem, None if box is None else box / problem.size)
    if norm is not None:
        size = jnp.sqrt(square(u if problem.root is None else dot(problem.root.T, u)))
        most = norm / problem.size
        feasible &= size <= most * (1 + ROUNDING * float(jnp.finfo(ell.dtype).eps))
        u = u * jnp.minimum(1.0, most / jnp.maximum(size, most))
    feasible &= _met(problem, u, count)
    u = _within(u * problem.size, box)
    finite = jnp.all(jnp.isfinite(u))
    return MinNormInput(jnp.where(finite, u, 0.0), well & feasible & finite)


def check_limits(box: float | None, norm: float | None) -> None:
    """Raises `TypeError` or `ValueError` for a limit that is not a positive number."""
    for name, limit in (("box", box), ("norm", norm)):
        if limit is None:
            continue
        if isinstance(limit, bool) or not isinstance(limit, Real):
            raise TypeError(f"`{name}` must be a number, or None for no limit; got {limit!r}.")
        if not limit > 0:
            raise ValueError(f"`{name}` must be positive, as it limits a size; got {limit}.")


def _check_rows(ell: Any, b: Any, metric: Any) -> None:
    """Raises `TypeError` or `ValueError` unless shapes fit each other."""
    for name, value, shape in (("ell", ell, "(rows, inputs)"), ("b", b, "(rows,)")):
        kind = getattr(value, "dtype", None)
        if kind is None or not jnp.issubdtype(kind, jnp.floating):
            actual = type(value).__name__ if kind is None else f"one of {kind}"
            raise TypeError(
                f"`{name}` must be an array of floating-point numbers, of shape {shape}; got {actual}."
            )
    if ell.ndim != 2:
        raise ValueError(
            f"`ell` must have shape (rows, inputs), one row per requirement; got {ell.shape}."
        )
    if b.shape != ell.shape[:1]:
        raise ValueError(
            f"`b` must have shape {ell.shape[:1]}, one number per row of `ell`; got {b.shape}."
        )
    check_metric(metric, ell.shape[1])
    if metric is not None and metric.ndim != 2:
        raise ValueError(
            f"`metric` must be the one matrix of this agent, of shape {(ell.shape[1],) * 2}; got {metric.shape}."
        )


def _unit_rows(
    ell: Float[Array, "rows inputs"], b: Float[Array, " rows"]
) -> tuple[Float[Array, "rows inputs"], Float[Array, " rows"], Bool[Array, ""]]:
    """Rows of length one and their distances from the origin; zeros for those that no input meets or that ask nothing.

    And whether there is none that no input meets. Entries are divided by the largest of their row before they are squared,
    so that squares neither over- nor underflow.
    """
    number = jnp.finfo(ell.dtype)
    tiny = float(number.tiny)
    # The result does not depend on it, so it has no gradient either.
    top = jax.lax.stop_gradient(largest(ell))
    live = (top >= tiny) & (top <= 0.01 / tiny)  # not so for nan
    scale = 1 / jnp.where(live, top, 1.0)
    near_one = jnp.where(live[:, None], ell, 0.0) * scale[:, None]
    inverse = 1 / jnp.sqrt(jnp.where(live, square(near_one), 1.0))
    asks = b * (scale * inverse) < jnp.inf
    distance = jnp.where(live & asks, b, 0.0) * (scale * inverse)
    # What is asked for must not get lost where numbers end.
    least = tiny / float(number.eps)
    distance = jnp.where(live & asks & (b > 0), jnp.maximum(distance, least), distance)
    unit = near_one * jnp.where(asks, inverse, 0.0)[:, None]
    return unit, distance, _all((live & asks) | ((top < tiny) & (b <= 0)))


class _Problem(NamedTuple):
    """A QP in which distances are of the size of one, and its rows in two systems of coordinates.

    Attributes:
        rows: Of length one in u.
        offset: Of the rows in u.
        unit: Rows of length one in v = L^T u, where the metric is the identity.
        length: Of `rows` there.
        root: L, with H = L L^T; None where H is the identity.
        size: Of the distances, which is the unit of u and v.
    """

    rows: Float[Array, "rows inputs"]
    offset: Float[Array, " rows"]
    unit: Float[Array, "rows inputs"]
    length: Float[Array, " rows"]
    root: Float[Array, "inputs inputs"] | None
    size: Float[Array, ""]

    def back(self, v: Float[Array, " inputs"]) -> Float[Array, " inputs"]:
        """The input u = L^-T v."""
        return v if self.root is None else above(self.root, v)

    def project(
        self, lack: Float[Array, " rows"]
    ) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
        """The smallest input that brings rows down by as much as they lack; whether there is one."""
        distance = lack / self.length
        most = jnp.max(distance)
        size = jnp.where(most > 0, most, 1.0)
        v, feasible = _project(self.unit, _near(distance / size))
        return self.back(v) * size, feasible


def _near(distance: Float[Array, " rows"]) -> Float[Array, " rows"]:
    """Rows so far away (-inf, too) that numbers do not tell the origin from the point that is looked for."""
    return jnp.maximum(distance, -0.1 / float(jnp.finfo(distance.dtype).eps) ** 2)


def _in_metric(
    rows: Float[Array, "rows inputs"],
    offset: Float[Array, " rows"],
    metric: Float[Array, "inputs inputs"] | None,
) -> _Problem:
    """In v the metric is the identity, and a row reads (L^-1 ell) . v + b <= 0."""
    root = None if metric is None else factor(metric)
    whitened = rows if root is None else below(root, rows)
    length = jnp.sqrt(square(whitened))
    length = jnp.where(length > 0, length, 1.0)
    most = jnp.max(offset / length)
    size = jnp.where(most > 0, most, 1.0)
    offset = length * _near(offset / (length * size))
    return _Problem(rows, offset, whitened / length[:, None], length, root, size)


_Passes = tuple[Array, Array, Array, Array, Array]  # u, feasible, lack, rounding, passes


def _solved(
    problem: _Problem, box: Float[Array, ""] | None
) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
    """The input in the problem's own unit, and whether no contradiction was found.

    A solution is exact up to the precision of its own size, which is much beside a small row. So once more, from
    where it led: the smallest step that makes good what rows lack there.
    """
    if problem.rows.shape[0] <= 2:
        u, feasible = problem.project(problem.offset)
        u = _within(u, box)
        step, _ = problem.project(_lack(problem, u)[0])
        return jnp.where(feasible, _within(u + step, box), u), feasible

    def short(state: _Passes) -> Bool[Array, ""]:
        _, feasible, lack, rounding, passes = state
        return (passes == 0) | (feasible & jnp.any(lack > 2 * rounding) & (passes <= PASSES))

    def once_more(state: _Passes) -> _Passes:
        u, _, lack, rounding, passes = state
        step, feasible = problem.project(lack - rounding)
        u = _within(u + step, box)
        return u, feasible, *_lack(problem, u), passes + 1

    # The solution itself is the first pass, from u = 0: what is compiled holds one projection instead of two.
    rounding = jnp.zeros_like(problem.offset)
    start = (
        jnp.zeros_like(problem.rows[0]),
        jnp.asarray(True),
        problem.offset,
        rounding,
        jnp.asarray(0),
    )
    u, feasible, *_ = jax.lax.while_loop(short, once_more, start)
    return u, feasible


def _lack(
    problem: _Problem, u: Float[Array, " inputs"]
) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
    """By how much each row is not met (negative: to spare), and what rounding there may come to."""
    lack = dot(problem.rows, u) + problem.offset
    size = dot(jnp.abs(problem.rows), jnp.abs(u)) + jnp.abs(problem.offset)
    return lack, ROUNDING * float(jnp.finfo(u.dtype).eps) * size


def _met(problem: _Problem, u: Float[Array, " inputs"], count: int) -> Bool[Array, ""]:
    """Whether the first rows are met, each at its own scale."""
    lack = dot(problem.rows[:count], u) + problem.offset[:count]
    size = jnp.sqrt(square(u)) + jnp.abs(problem.offset[:count])
    return jnp.all(lack <= 2 * ROUNDING * float(jnp.finfo(u.dtype).eps) * size)


def _all(each: Bool[Array, " rows"]) -> Bool[Array, ""]:
    return reduce(jnp.logical_and, each) if len(each) <= FEW else jnp.all(each)


def _within(
    u: Float[Array, " inputs"], box: Float[Array, ""] | float | None
) -> Float[Array, " inputs"]:
    return u if box is None else jnp.clip(u, -box, box)


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
    return project_origin(unit, distance, crossing(unit.dtype))


def _project_two(
    unit: Float[Array, "2 inputs"], distance: Float[Array, " 2"]
) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
    """Active sets {}, {0}, {1}, {0, 1} in turn."""
    first, second = distance[0], distance[1]
    overlap = dot(unit[0], unit[1])
    one = jnp.maximum(distance, 0.0)
    helps = overlap * one  # what meeting the one row alone does for the other
    precision = float(jnp.finfo(unit.dtype).eps)
    only_first = second - helps[0] <= ROUNDING * precision * (jnp.abs(second) + jnp.abs(helps[0]))
    only_second = first - helps[1] <= ROUNDING * precision * (jnp.abs(first) + jnp.abs(helps[1]))
    # The part of row 1 across row 0, twice: 1 - overlap^2 would have no digits left for nearly parallel rows.
    across = unit[1] - overlap * unit[0]
    across = across - dot(across, unit[0]) * unit[0]
    breadth = square(across)
    cross = breadth > crossing(unit.dtype) ** 2
    sine = jnp.sqrt(jnp.where(cross, breadth, 1.0))
    # A little further than the plane of row 1, so that rounding beside a large row 0 leaves it met.
    beyond = second - overlap * first + 2 * precision * (jnp.abs(second) + jnp.abs(overlap * first))
    both = -first * unit[0] - (beyond / sine) * (across / sine)
    # Opposed rows that cross nowhere: half of each, and said to be infeasible.
    neither = -0.5 * (one[0] * unit[0] + one[1] * unit[1])
    # Where either would do, rows agree up to rounding: the larger one is needed, and the smaller one idle.
    use_first = only_first & (~only_second | (one[0] >= one[1]))
    alone = -jnp.where(use_first, one[0] * unit[0], one[1] * unit[1])
    # Numbers may end before the planes meet.
    cross &= jnp.abs(first) + jnp.abs(beyond / sine) < jnp.inf
    v = jnp.where(only_first | only_second, alone, jnp.where(cross, both, neither))
    return v, only_first | only_second | cross
