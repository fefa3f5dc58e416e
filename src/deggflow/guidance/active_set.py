"""Dual active-set method of Goldfarb and Idnani (1983) for the projection of the origin onto a polyhedron.

Fixed shapes and no branches, so that it runs batched inside a compiled program. Directions come from an
orthonormal basis of the active rows, orthogonalised twice: nearly opposed rows keep their digits, which a
Gram matrix would square away.
"""

from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Bool, Float, Int

FEW = 4


def resolution(dtype: jnp.dtype) -> float:
    """Sine of the angle between two rows below which they count as parallel, at this precision."""
    return float(50 * jnp.finfo(dtype).eps)


def crossing(dtype: jnp.dtype) -> float:
    """Sine above which a QP lets two rows cross: half the resolution.

    So whoever has an effective direction, which is longer than the resolution, is given an input, however it is rounded.
    """
    return resolution(dtype) / 2


def dot(a: Float[Array, "*rows inputs"], b: Float[Array, "*#rows inputs"]) -> Float[Array, "*rows"]:
    """The inner product, of each row. Few entries one by one: a loop over them costs more than they do."""
    if a.shape[-1] > FEW:
        return a @ b if b.ndim == 1 else jnp.sum(a * b, axis=-1)
    return reduce(jnp.add, [a[..., k] * b[..., k] for k in range(a.shape[-1])])


def square(a: Float[Array, "*rows inputs"]) -> Float[Array, "*rows"]:
    """Of the length of each row."""
    if a.shape[-1] > FEW:
        return jnp.sum(a**2, axis=-1)
    return reduce(jnp.add, [a[..., k] ** 2 for k in range(a.shape[-1])])


def largest(a: Float[Array, "*rows inputs"]) -> Float[Array, "*rows"]:
    """Size of the largest entry of each row; not a number where one is not."""
    if a.shape[-1] > FEW:
        return jnp.max(jnp.abs(a), axis=-1)
    return reduce(jnp.maximum, [jnp.abs(a[..., k]) for k in range(a.shape[-1])])


class _HalfSpaces(NamedTuple):
    """The half-spaces `unit @ v + distance <= 0`, as of `project_origin`."""

    unit: Float[Array, "rows inputs"]
    distance: Float[Array, " rows"]


class _State(NamedTuple):
    """Between two steps.

    Attributes:
        v: Projection onto the active rows so far.
        multiplier: Of active rows, else 0.
        active: Which rows are.
        entering: The violated row that is being made active; -1: none is chosen yet.
        entering_multiplier: Of that row.
        infeasible: Whether rows were found to contradict each other.
        done: Whether nothing is left to do.
        steps: Taken so far.
    """

    v: Float[Array, " inputs"]
    multiplier: Float[Array, " rows"]
    active: Bool[Array, " rows"]
    entering: Int[Array, ""]
    entering_multiplier: Float[Array, ""]
    infeasible: Bool[Array, ""]
    done: Bool[Array, ""]
    steps: Int[Array, ""]


def _basis(
    unit: Float[Array, "rows inputs"], active: Bool[Array, " rows"]
) -> tuple[Float[Array, "rows inputs"], Float[Array, "rows rows"]]:
    """Q with orthonormal rows (zero for inactive ones) and lower triangular R with `unit[active] = R @ Q`."""
    rows = unit.shape[0]

    def add(
        k: Int[Array, ""], carry: tuple[Float[Array, "rows inputs"], Float[Array, "rows rows"]]
    ) -> tuple[Float[Array, "rows inputs"], Float[Array, "rows rows"]]:
        q, r = carry
        once = q @ unit[k]
        rest = unit[k] - once @ q
        twice = q @ rest
        rest = rest - twice @ q
        size = jnp.sqrt(jnp.sum(rest**2))
        use = active[k] & (size > 0)
        new = jnp.where(use, rest / jnp.where(use, size, 1.0), 0.0)
        line = jnp.where(active[k], once + twice, 0.0).at[k].set(jnp.where(use, size, 1.0))
        return q.at[k].set(new), r.at[k].set(line)

    start = jnp.zeros_like(unit), jnp.zeros((rows, rows), unit.dtype)
    return jax.lax.fori_loop(0, rows, add, start)


def _choose(state: _State, half_spaces: _HalfSpaces, tolerance: float) -> _State:
    """The most violated row, unless one is entering already; done where none is violated."""
    unit, distance = half_spaces
    violation = jnp.where(state.active, -jnp.inf, unit @ state.v + distance)
    worst = jnp.argmax(violation)
    largest = jnp.max(distance, initial=0.0)  # the solution is no shorter
    size = largest + jnp.sqrt(jnp.sum(state.v**2)) + jnp.abs(distance[worst])
    converged = violation[worst] <= tolerance * size
    new = state.entering < 0
    return state._replace(
        entering=jnp.where(new & ~converged, worst, state.entering),
        entering_multiplier=jnp.where(new, 0.0, state.entering_multiplier),
        done=state.done | (new & converged),
    )


def _step(state: _State, half_spaces: _HalfSpaces, parallel: float) -> _State:
    """One step in primal and dual space toward the entering row; a row that blocks it leaves."""
    unit, distance = half_spaces
    rows = unit.shape[0]
    row = jnp.maximum(state.entering, 0)
    normal = unit[row]
    q, r = _basis(unit, state.active)
    once = q @ normal
    across = normal - once @ q
    twice = q @ across
    across = across - twice @ q
    # How the active rows' multipliers fall as that of the entering row rises: normal = dual @ unit + across.
    dual = jnp.where(state.active, solve_triangular(r, once + twice, lower=True, trans="T"), 0.0)
    falling = state.active & (dual > 0)
    ratio = jnp.where(falling, state.multiplier / jnp.where(falling, dual, 1.0), jnp.inf)
    leaving = jnp.argmin(ratio)
    partial = ratio[leaving]
    square = jnp.sum(across**2)
    movable = square > parallel**2
    violation = unit[row] @ state.v + distance[row]
    full = jnp.where(movable, violation / jnp.where(movable, square, 1.0), jnp.inf)
    length = jnp.minimum(partial, full)
    stuck = jnp.isinf(length)  # no primal step, nothing to drop: the rows contradict each other
    length = jnp.where(stuck, 0.0, length)
    arrives = ~stuck & (full <= partial)
    multiplier = jnp.maximum(state.multiplier - length * dual, 0.0)
    entered = state.entering_multiplier + length
    here = jnp.arange(rows) == row
    drops = ~arrives & ~stuck & (jnp.arange(rows) == leaving)
    return state._replace(
        v=jnp.where(movable, state.v - length * across, state.v),
        multiplier=jnp.where(arrives & here, entered, jnp.where(drops, 0.0, multiplier)),
        active=(state.active | (arrives & here)) & ~drops,
        entering=jnp.where(arrives | stuck, -1, state.entering),
        entering_multiplier=entered,
        infeasible=stuck,
        done=stuck,
        steps=state.steps + 1,
    )


def project_origin(
    unit: Float[Array, "rows inputs"], distance: Float[Array, " rows"], parallel: float
) -> tuple[Float[Array, " inputs"], Bool[Array, ""]]:
    """The point nearest to the origin with `unit @ v + distance <= 0`, and whether there is one.

    Args:
        unit: Rows of length one; rows of zeros must have a distance of at most zero.
        distance: How far along its row the origin is outside each half-space.
        parallel: Sine of the angle to the active rows' span below which a row counts as inside it.
    """
    rows = unit.shape[0]
    half_spaces = _HalfSpaces(unit, distance)
    tolerance = 4 * float(jnp.finfo(unit.dtype).eps)

    def body(state: _State) -> _State:
        choice = _choose(state, half_spaces, tolerance)
        after = _step(choice, half_spaces, parallel)
        return jax.tree.map(lambda a, b: jnp.where(choice.done, a, b), choice, after)

    start = _State(
        jnp.zeros_like(unit[0]),
        jnp.zeros_like(distance),
        jnp.zeros(rows, bool),
        jnp.asarray(-1),
        jnp.zeros((), unit.dtype),
        jnp.asarray(False),
        jnp.asarray(False),
        jnp.asarray(0),
    )
    limit = 10 * rows + 10  # far beyond what the method needs; only rounding could make it cycle
    end = jax.lax.while_loop(lambda s: ~s.done & (s.steps < limit), body, start)
    v = _polish(half_spaces, end)
    return v, end.done & ~end.infeasible


def _polish(half_spaces: _HalfSpaces, end: _State) -> Float[Array, " inputs"]:
    """The active rows' own intersection: rounding of the steps that led there is gone."""
    unit, distance = half_spaces
    q, r = _basis(unit, end.active)
    held = jnp.where(end.active, -distance, 0.0)
    v = solve_triangular(r, held, lower=True) @ q
    return jnp.where(end.infeasible, end.v, v)
