"""Algorithm 1: guided generation, of one sample or of many."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .flow import Field
from .guidance import AbstractGuidance, GuidanceReport
from .identity import requirement_numbers
from .solver import EULER, RungeKutta
from .step_guard import GuardedSteps, SampleProgress, StepGuard, Velocity, finish
from .trace import Point, Summary, Trace, Work, add_point, empty_summary, traced

DEFAULT_STEPS = 100
GUARD = StepGuard()


class Generation(NamedTuple):
    """A generated sample.

    Attributes:
        z: State at tau = 1.
        summary: Of every accepted point.
        trace: At the points of the grid; None if it was not kept.
        path: z at every point of the grid; None if it was not kept.
    """

    z: Float[Array, "agents dim"]
    summary: Summary
    trace: Trace | None
    path: Float[Array, "points agents dim"] | None

    @property
    def work(self) -> Work:
        """Evaluations, refused and forced steps."""
        return self.summary.work


def refined_grid(steps: int = DEFAULT_STEPS, power: float = 2.0) -> Float[Array, " points"]:
    """The grid tau = 1 - (1 - s)^power for equal steps of s: finer toward tau = 1, where omega is large.

    `power = 1` is the uniform grid.
    """
    if steps < 1:
        raise ValueError(f"`steps` must be at least 1; got {steps}.")
    if not power > 0:
        raise ValueError(
            f"`power` must be positive, else the grid does not reach tau = 1; got {power}."
        )
    return 1 - (1 - jnp.linspace(0.0, 1.0, steps + 1)) ** power


def generate(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array | np.ndarray, "agents dim"],
    condition: Any,
    *,
    grid: Float[Array | np.ndarray, " points"] | None = None,
    solver: RungeKutta = EULER,
    guard: StepGuard | None = GUARD,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    stops: Float[Array | np.ndarray, " agents"] | None = None,
    keep_trace: bool = True,
    keep_path: bool = False,
) -> Generation:
    """Carries z(0) to z(1) under the nominal field and the guidance, by explicit steps on the grid.

    Args:
        field: Nominal vector field, any callable (tau, z, condition) -> dz/dtau of the shape of z.
        guidance: `DecoupledGuidance`, or `NoGuidance` for the nominal sample.
        z0: Initial sample; its floating-point type is that of the generation.
        condition: What field and requirements are conditioned on, any pytree.
        grid: Increasing values of tau from 0 to 1; `refined_grid()` by default.
        solver: `EULER`, `HEUN` or `RK4`.
        guard: Compares every step with its limits and halves those that fail; None for fixed steps. Guarded steps are
            a `while_loop`, which has no reverse-mode gradient; fixed steps have one.
        mask: Which agents are present in a padded team; None: all. Absent ones stay at z(0), are asked for nothing and
            judge nothing. Functions of several agents must leave them out: keep the mask in the condition, too.
        stops: tau at which each agent stops for good (u_i = 0, dz_i/dtau = 0); None if all of them move.
        keep_trace: Also return values, bounds and rows at every grid point.
        keep_path: Also return z at every grid point.

    Raises:
        TypeError: z(0), the field's or a requirement's value is not of floating-point type.
        ValueError: A shape does not fit, or the grid does not increase from 0 to 1 (where its values are known; in a
            compiled program that is handed the grid they are not, and `certify` looks at them).

    Source: paper, alg:guided_sampling.
    """
    z0, grid = _checked_start(z0, 2), _checked_grid(grid, z0)
    mask, stops = _per_agent("mask", mask, z0, bool), _per_agent("stops", stops, z0, z0.dtype)
    velocity = _velocity(field, guidance, condition, mask, stops)
    state = guidance.init(z0, condition, mask)
    if guard is None or not guidance.names:
        generation = _fixed_steps(
            velocity, state, z0, condition, grid, solver, mask, keep_trace, keep_path
        )
        return _signed(generation, guidance)
    steps = GuardedSteps(grid, solver, guard, keep_trace, keep_path)
    end = jax.lax.while_loop(
        steps.unfinished,
        lambda at: steps.advance(velocity, guidance.on_forced_step, mask, at),
        steps.start(velocity, state, z0, condition),
    )
    return _signed(_generation(grid, end), guidance)


def generate_batch(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array | np.ndarray, "samples agents dim"],
    condition: Any,
    *,
    grid: Float[Array | np.ndarray, " points"] | None = None,
    solver: RungeKutta = EULER,
    guard: StepGuard | None = GUARD,
    mask: Bool[Array | np.ndarray, "samples agents"] | None = None,
    stops: Float[Array | np.ndarray, "samples agents"] | None = None,
    keep_trace: bool = True,
    keep_path: bool = False,
) -> Generation:
    """`generate` of many samples at once; nothing but the time it takes depends on which are together.

    Under `jax.vmap(generate)` every sample of a batch with guarded steps costs as much as the slowest; here the
    slow ones are gathered and finished by themselves.

    Args: as of `generate`, where `z0`, `mask`, `stops` and the leaves of `condition` have a leading axis of samples.
    """
    z0, grid = _checked_start(z0, 3), _checked_grid(grid, z0)
    mask, stops = _per_agent("mask", mask, z0, bool), _per_agent("stops", stops, z0, z0.dtype)
    check_leading_axis(condition, len(z0))
    inputs = (condition, mask, stops)
    if guard is None or not guidance.names:

        def fixed(z0: Float[Array, "agents dim"], inputs: tuple[Any, Any, Any]) -> Generation:
            condition, mask, stops = inputs
            velocity = _velocity(field, guidance, condition, mask, stops)
            state = guidance.init(z0, condition, mask)
            return _fixed_steps(
                velocity, state, z0, condition, grid, solver, mask, keep_trace, keep_path
            )

        return _signed(jax.vmap(fixed)(z0, inputs), guidance)
    steps = GuardedSteps(grid, solver, guard, keep_trace, keep_path)

    def start(z0: Float[Array, "agents dim"], inputs: tuple[Any, Any, Any]) -> SampleProgress:
        condition, mask, stops = inputs
        state = guidance.init(z0, condition, mask)
        velocity = _velocity(field, guidance, condition, mask, stops)
        return steps.start(velocity, state, z0, condition)

    def advance(inputs: tuple[Any, Any, Any], at: SampleProgress) -> SampleProgress:
        condition, mask, stops = inputs
        velocity = _velocity(field, guidance, condition, mask, stops)
        return steps.advance(velocity, guidance.on_forced_step, mask, at)

    end = finish(steps, advance, inputs, jax.vmap(start)(z0, inputs))
    return _signed(_generation(jnp.broadcast_to(grid, (len(z0), len(grid))), end), guidance)


def _generation(tau: Float[Array, "... points"], end: SampleProgress) -> Generation:
    trace = None if end.trace is None else Trace(tau, *end.trace)
    return Generation(end.z, end.summary, trace, end.path)


def _signed(generation: Generation, guidance: AbstractGuidance) -> Generation:
    """With the numbers of the requirements under which it was generated."""
    numbers = requirement_numbers(getattr(guidance, "requirements", ()))
    shape = *generation.summary.points.shape, len(numbers)
    return generation._replace(
        summary=generation.summary._replace(requirements=jnp.broadcast_to(numbers, shape))
    )


def _velocity(
    field: Field,
    guidance: AbstractGuidance,
    condition: Any,
    mask: Bool[Array, " agents"] | None,
    stops: Float[Array, " agents"] | None,
) -> Velocity:
    """dz/dtau of the guided field."""

    def velocity(
        state: Any, tau: Float[Array, ""], z: Float[Array, "agents dim"]
    ) -> tuple[Any, Float[Array, "agents dim"], GuidanceReport]:
        drift = _checked_drift(field(tau, z, condition), z)
        moving = mask
        if stops is not None:
            moving = tau < stops if mask is None else mask & (tau < stops)
        if moving is None:
            state, correction, report = guidance(state, tau, z, drift, condition)
            return state, drift + correction, report
        drift = jnp.where(moving[:, None], drift, 0.0)
        state, correction, report = guidance(state, tau, z, drift, condition, moving)
        return state, drift + jnp.where(moving[:, None], correction, 0.0), report

    return velocity


def _fixed_steps(
    velocity: Velocity,
    state: Any,
    z0: Float[Array, "agents dim"],
    condition: Any,
    grid: Float[Array, " points"],
    solver: RungeKutta,
    mask: Bool[Array, " agents"] | None,
    keep_trace: bool,
    keep_path: bool,
) -> Generation:
    yes, no = jnp.asarray(True), jnp.asarray(False)
    *_, shapes = jax.eval_shape(velocity, state, grid[0], z0)
    nowhere = jnp.zeros(shapes.value.shape, bool)

    def step(
        at: tuple[Any, Float[Array, "agents dim"], Summary],
        span: tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]],
    ) -> tuple[tuple[Any, Float[Array, "agents dim"], Summary], Any]:
        (state, z, summary), (tau, after, last) = at, span
        state, slope, report = velocity(state, tau, z)
        point = Point(tau, z, report, yes, no, nowhere, no, nowhere, last)
        end = solver.step(lambda t, x: velocity(state, t, x)[1], tau, z, slope, after - tau)
        # No step follows tau = 1, where some fields are infinite.
        ahead = state, jnp.where(last, z, end), add_point(summary, point, mask)
        return ahead, (traced(report) if keep_trace else None, z if keep_path else None)

    spans = grid, jnp.append(grid[1:], grid[-1]), jnp.arange(len(grid)) == len(grid) - 1
    start = state, z0, empty_summary(grid, z0, condition, shapes.value.shape[0])
    (_, z, summary), (trace, path) = jax.lax.scan(step, start, spans)
    return Generation(z, summary, None if trace is None else Trace(grid, *trace), path)


def _checked_start(z0: Any, ndim: int) -> Array:
    """z(0) as an array of JAX."""
    start = z0 if isinstance(z0, jax.Array | np.ndarray) else np.asarray(z0)
    shape = "(agents, dim)" if ndim == 2 else "(samples, agents, dim)"
    if not jnp.issubdtype(start.dtype, jnp.floating):
        raise TypeError(f"`z0` must be a floating-point array of shape {shape}; got {start.dtype}.")
    if start.ndim != ndim or 0 in start.shape:
        other = {2: " `generate` takes one sample.", 3: " `generate_batch` takes a batch."}
        hint = other.get(start.ndim, "") if start.ndim != ndim else ""
        raise ValueError(f"`z0` must have shape {shape}; got {start.shape}.{hint}")
    return jnp.asarray(start)


def _checked_grid(grid: Any, z0: Any) -> Float[Array, " points"]:
    """The grid in the type of the states; its values are looked at where they are known."""
    dtype = jnp.asarray(z0).dtype
    if grid is None:
        grid = refined_grid()
    elif not isinstance(grid, jax.Array):
        grid = np.asarray(grid, np.float64)
    if grid.ndim != 1 or len(grid) < 2:
        raise ValueError(
            f"`grid` must be at least two values of tau, of shape (points,); got shape {grid.shape}."
        )
    if not isinstance(grid, jax.core.Tracer):
        check_tau("grid", np.asarray(np.asarray(grid, dtype), np.float64))
    return jnp.asarray(grid, dtype)


def check_tau(name: str, tau: Float[np.ndarray, " points"]) -> None:
    """Raises `ValueError` unless values of tau increase from 0 to 1."""
    if not (np.diff(tau) > 0).all():
        k = int(np.argmin(np.diff(tau) > 0))
        raise ValueError(
            f"`{name}` must increase; got {tau[k]:.6g} before {tau[k + 1]:.6g} at point {k + 1}."
        )
    if tau[0] != 0 or tau[-1] != 1:
        raise ValueError(f"`{name}` must go from 0 to 1; got {tau[0]:.6g} to {tau[-1]:.6g}.")


def _per_agent(name: str, value: Any, z0: Any, dtype: Any) -> Array | None:
    """A value for each agent (and sample), in a type."""
    if value is None:
        return None
    array = value if isinstance(value, jax.Array | np.ndarray) else np.asarray(value)
    if dtype is bool and array.dtype != bool:
        raise TypeError(
            f"`{name}` must be boolean, True for agents that are present; got {array.dtype}."
        )
    if array.shape != z0.shape[:-1]:
        raise ValueError(
            f"`{name}` must have shape {z0.shape[:-1]}, one value for each agent; got {array.shape}."
        )
    return jnp.asarray(array, dtype)


def check_leading_axis(condition: Any, samples: int, name: str = "condition") -> None:
    """Raises `ValueError` unless every leaf of a condition has a leading axis of samples."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(condition):
        if jnp.ndim(leaf) == 0 or jnp.shape(leaf)[0] != samples:
            raise ValueError(
                f"every leaf of `{name}` must have a leading axis of {samples} samples; "
                f"got shape {jnp.shape(leaf)} at {name}{jax.tree_util.keystr(path)}. One condition for all samples is "
                "broadcast first: `jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (samples, *jnp.shape(leaf))), condition)`."
            )


def _checked_drift(drift: Any, z: Float[Array, "agents dim"]) -> Float[Array, "agents dim"]:
    """The field's value, of the shape and in the type of the states: nothing is broadcast."""
    is_array = isinstance(drift, jax.Array | np.ndarray)
    if not is_array or not jnp.issubdtype(drift.dtype, jnp.floating):
        kind = drift.dtype if is_array else type(drift).__name__
        raise TypeError(f"`field` must return a floating-point array, dz/dtau; got {kind}.")
    if drift.shape != z.shape:
        raise ValueError(
            f"`field` must return dz/dtau of the shape of z, {z.shape}; got {drift.shape}."
        )
    return jnp.asarray(drift, z.dtype)
