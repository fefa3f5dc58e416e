"""Algorithm 1: guided generation, of one sample or of many."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .arguments import check_leading_axis, checked_grid, checked_start, per_agent
from .drift import EVERY_STEP, AbstractDrift, Interval, aligned
from .flow import Field
from .guidance import AbstractGuidance, AbstractRequirement
from .guidance.decoupled import as_guidance
from .guided_field import GuidedField
from .hints import advise_compiling
from .identity import requirement_numbers
from .notebook import generation_html
from .shapes import Mask, Scalar, States
from .solver import EULER, RungeKutta
from .step_guard import GuardedSteps, SampleProgress, StepGuard, finish
from .trace import Point, Summary, Trace, Work, add_point, as_accepted, empty_summary, traced

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

    z: States
    summary: Summary
    trace: Trace | None
    path: Float[Array, "points agents dim"] | None

    @property
    def work(self) -> Work:
        """Evaluations, refused and forced steps."""
        return self.summary.work

    def _repr_html_(self) -> str:
        """What notebooks show."""
        return generation_html(self)


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
    guidance: AbstractGuidance | Sequence[AbstractRequirement],
    z0: Float[Array | np.ndarray, "agents dim"],
    condition: Any,
    *,
    grid: Float[Array | np.ndarray, " points"] | None = None,
    solver: RungeKutta = EULER,
    drift: AbstractDrift = EVERY_STEP,
    guard: StepGuard | None = GUARD,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    stops: Float[Array | np.ndarray, " agents"] | None = None,
    keep_trace: bool = True,
    keep_path: bool = False,
) -> Generation:
    """Carries z(0) to z(1) under the nominal field and the guidance, by explicit steps on the grid.

    Call `equinox.filter_jit(generate)`, kept in a variable, more than once: a call outside of `jax.jit` compiles its loops
    anew, which takes seconds.

    Args:
        field: Nominal vector field, any callable (tau, z, condition) -> dz/dtau of the shape of z.
        guidance: `DecoupledGuidance`, or a tuple of requirements; `NoGuidance` for the nominal sample.
        z0: Initial sample; its floating-point type is that of the generation.
        condition: What field and requirements are conditioned on, any pytree.
        grid: Increasing values of tau from 0 to 1; `refined_grid()` by default.
        solver: `EULER`, `HEUN` or `RK4`.
        drift: How often the field is evaluated: wherever the guidance is (`EveryStep()`), or at the points of a coarser
            grid, `Held(16)`, `Extrapolated(16)` or `Midpoint(16)`. The nearest points of `grid` are moved onto these.
        guard: Compares every step with its limits and halves those that fail; None for fixed steps. Guarded steps are
            a `while_loop`, which has no reverse-mode gradient; fixed steps have one.
        mask: Which agents are present in a padded team; None: all. Absent ones stay at z(0), are asked for nothing and
            judge nothing. Functions of several agents must leave them out: keep the mask in the condition, too.
        stops: tau at which each agent stops for good (u_i = 0, dz_i/dtau = 0), and from the start, with any prediction, if it
            is negative; None if all of them move.
        keep_trace: Also return values, bounds and rows at every grid point.
        keep_path: Also return z at every grid point.

    Raises:
        TypeError: z(0), the field's or a requirement's value is not of floating-point type, or a setting is of another type.
        ValueError: A shape does not fit, or the grid does not increase from 0 to 1 (where its values are known; in a
            compiled program that is handed the grid they are not, and `certify` looks at them).

    Source: paper, alg:guided_sampling.
    """
    guidance = _guidance_by(guidance)
    check_settings(solver, drift, guard)
    z0, grid = checked_start(z0, 2), checked_grid(grid, refined_grid, z0)
    grid, starts = aligned(grid, drift.macro_grid())
    mask, stops = per_agent("mask", mask, z0, bool), per_agent("stops", stops, z0, z0.dtype)
    guided = GuidedField(field, guidance, drift, grid, condition, mask, stops)
    z0 = guided.start(z0)
    state = guidance.init(z0, condition, mask)
    if guard is None or not guidance.names:
        generation = _fixed_steps(guided, state, z0, starts, solver, keep_trace, keep_path)
        advise_compiling("generate", generation.z)
        return completed(generation, guidance, drift, solver)
    steps = GuardedSteps(grid, solver, guard, keep_trace, keep_path)

    def macro_step(carry: _Carry, interval: Interval, on: GuardedSteps) -> _Carry:
        sample, drift_state = carry
        drift_state = drift.step(guided.nominal, drift_state, interval, sample.proposed_z)
        velocity = guided.velocity(drift_state)
        end = jax.lax.while_loop(
            on.unfinished,
            lambda at: on.advance(velocity, guidance.on_forced_step, mask, at),
            sample,
        )
        return end, drift_state

    drift_state = drift.init(z0)
    sample = steps.start(len(guidance.names), state, z0, condition)
    end = _over_macro_steps(macro_step, (sample, drift_state), steps, starts)
    advise_compiling("generate", end.z)
    return completed(_generation(grid, end), guidance, drift, solver)


def generate_batch(
    field: Field,
    guidance: AbstractGuidance | Sequence[AbstractRequirement],
    z0: Float[Array | np.ndarray, "samples agents dim"],
    condition: Any,
    *,
    grid: Float[Array | np.ndarray, " points"] | None = None,
    solver: RungeKutta = EULER,
    drift: AbstractDrift = EVERY_STEP,
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
    guidance = _guidance_by(guidance)
    check_settings(solver, drift, guard)
    z0, grid = checked_start(z0, 3), checked_grid(grid, refined_grid, z0)
    grid, starts = aligned(grid, drift.macro_grid())
    mask, stops = per_agent("mask", mask, z0, bool), per_agent("stops", stops, z0, z0.dtype)
    check_leading_axis(condition, len(z0))
    inputs = (condition, mask, stops)
    guided_by = partial(GuidedField, field, guidance, drift, grid)
    if guard is None or not guidance.names:

        def fixed(z0: States, inputs: _Inputs) -> Generation:
            guided = guided_by(*inputs)
            z0 = guided.start(z0)
            state = guidance.init(z0, *inputs[:2])
            return _fixed_steps(guided, state, z0, starts, solver, keep_trace, keep_path)

        batch = jax.vmap(fixed)(z0, inputs)
        advise_compiling("generate_batch", batch.z)
        return completed(batch, guidance, drift, solver)
    steps = GuardedSteps(grid, solver, guard, keep_trace, keep_path)

    def start(z0: States, inputs: _Inputs) -> _Carry:
        guided = guided_by(*inputs)
        z0 = guided.start(z0)
        state, drift_state = guidance.init(z0, *inputs[:2]), drift.init(z0)
        return steps.start(len(guidance.names), state, z0, inputs[0]), drift_state

    def macro_step(carry: _Carry, interval: Interval, on: GuardedSteps) -> _Carry:
        def begin(inputs: _Inputs, drift_state: Any, z: States) -> Any:
            return drift.step(guided_by(*inputs).nominal, drift_state, interval, z)

        def advance(given: tuple[_Inputs, Any], at: SampleProgress) -> SampleProgress:
            inputs, drift_state = given
            velocity = guided_by(*inputs).velocity(drift_state)
            return on.advance(velocity, guidance.on_forced_step, inputs[1], at)

        samples, drift_states = carry
        drift_states = jax.vmap(begin)(inputs, drift_states, samples.proposed_z)
        return finish(on, advance, (inputs, drift_states), samples), drift_states

    end = _over_macro_steps(macro_step, jax.vmap(start)(z0, inputs), steps, starts)
    advise_compiling("generate_batch", end.z)
    batch = _generation(jnp.broadcast_to(grid, (len(z0), len(grid))), end)
    return completed(batch, guidance, drift, solver)


def _guidance_by(guidance: AbstractGuidance | Sequence[AbstractRequirement]) -> AbstractGuidance:
    return guidance if isinstance(guidance, AbstractGuidance) else as_guidance(guidance)


def check_settings(solver: Any, drift: Any, guard: Any) -> None:
    """Checks the types of settings, which strings or numbers are easily taken for.

    Raises:
        TypeError: One is of another type.
    """
    for name, value, kind, examples in (
        ("solver", solver, RungeKutta, "`EULER`, `HEUN` or `RK4`"),
        ("drift", drift, AbstractDrift, "`EveryStep()`, `Held(16)` or another of `deggflow.drift`"),
        ("guard", guard, StepGuard | None, "`StepGuard()`, or None for fixed steps"),
    ):
        if not isinstance(value, kind):
            raise TypeError(f"`{name}` must be {examples}; got {value!r}.")


def check_one_sample(name: str, value: object, allowed: str, advice: str) -> None:
    """Checks that an argument is the generation of one sample.

    Args:
        name: Of the argument.
        value: It.
        allowed: All that it may be.
        advice: What to do with a batch.

    Raises:
        TypeError: It is no `Generation`.
        ValueError: It is of a batch.
    """
    if not isinstance(value, Generation):
        raise TypeError(f"`{name}` must be {allowed}; got {type(value).__name__}.")
    if np.ndim(value.z) != 2:
        raise ValueError(
            f"`{name}` must be one sample, z of shape (agents, dim); got {np.shape(value.z)}: {advice}."
        )


_Inputs = tuple[Any, Mask, Float[Array, " agents"] | None]
"""Condition, mask and stops of one sample."""

_Carry = tuple[SampleProgress, Any]
"""A sample under way, or a batch of them, and the state of the drift."""


def _over_macro_steps(
    run: Callable[[_Carry, Interval, GuardedSteps], _Carry],
    carry: _Carry,
    steps: GuardedSteps,
    starts: Int[Array, " macro_steps"],
) -> SampleProgress:
    """One macro step after another: the field is evaluated outside of the loops over guided steps."""
    grid = steps.grid
    if len(starts) == 1:
        return run(carry, (grid[0], grid[-1]), steps)[0]

    def one(carry: _Carry, interval: Interval) -> tuple[_Carry, None]:
        return run(carry, interval, steps._replace(until=interval[1])), None

    intervals = grid[starts], jnp.append(grid[starts[1:]], grid[-1])
    return jax.lax.scan(one, carry, intervals)[0][0]


def _generation(tau: Float[Array, "... points"], end: SampleProgress) -> Generation:
    summary, trace = as_accepted(end.summary, end.trace)
    return Generation(end.z, summary, None if trace is None else Trace(tau, *trace), end.path)


def completed(
    generation: Generation,
    guidance: AbstractGuidance,
    drift: AbstractDrift,
    solver: RungeKutta,
) -> Generation:
    """With the numbers of the requirements under which it was generated, and those of field evaluations."""
    numbers = requirement_numbers(getattr(guidance, "requirements", ()))
    summary = generation.summary
    evaluations = drift.field_evaluations(summary.work.evaluations * len(solver.weights))
    shape = *summary.points.shape, len(numbers)
    return generation._replace(
        summary=summary._replace(
            requirements=jnp.broadcast_to(numbers, shape),
            work=summary.work._replace(field_evaluations=evaluations),
        )
    )


class _FixedStep(NamedTuple):
    """A step of the grid.

    Attributes:
        number: Of the step, from 0.
        tau: Where it begins.
        after: Where it ends.
        last: Whether it is none, after tau = 1.
        begins: Whether a macro step begins there.
        macro_end: Where that ends.
    """

    number: Int[Array, ""]
    tau: Scalar
    after: Scalar
    last: Bool[Array, ""]
    begins: Bool[Array, ""]
    macro_end: Scalar


_FixedCarry = tuple[Any, Any, States, Summary]
"""State of the guidance, state of the drift, z and the summary so far."""


def _fixed_steps(
    guided: GuidedField,
    state: Any,
    z0: States,
    starts: Int[Array, " macro_steps"],
    solver: RungeKutta,
    keep_trace: bool,
    keep_path: bool,
) -> Generation:
    yes, no = jnp.asarray(True), jnp.asarray(False)
    grid, drift, drift_state = guided.grid, guided.drift, guided.drift.init(z0)
    rows = len(guided.guidance.names)
    nowhere = jnp.zeros(rows, bool)

    def step(carry: _FixedCarry, at: _FixedStep) -> tuple[_FixedCarry, Any]:
        state, drift_state, z, summary = carry
        if drift.step_evaluations:
            # The same points for all samples of a batch: at the others, no field is evaluated.
            drift_state = jax.lax.cond(
                at.begins,
                lambda old: drift.step(guided.nominal, old, (at.tau, at.macro_end), z),
                lambda old: old,
                drift_state,
            )
        velocity = guided.velocity(drift_state)
        state, slope, report = velocity(state, at.number, at.tau, z)
        point = Point(at.tau, z, report, yes, no, nowhere, no, nowhere, at.last)
        end = solver.step(
            lambda t, x: velocity(state, at.number, t, x)[1], at.tau, z, slope, at.after - at.tau
        )
        # No step follows tau = 1, where some fields are infinite.
        summary = add_point(summary, point, guided.mask)
        ahead = state, drift_state, jnp.where(at.last, z, end), summary
        return ahead, (traced(report) if keep_trace else None, z if keep_path else None)

    number = jnp.arange(len(grid))
    macro_ends = jnp.append(grid[starts[1:]], grid[-1])
    spans = _FixedStep(
        number, grid, jnp.append(grid[1:], grid[-1]), number == len(grid) - 1,
        jnp.zeros(len(grid), bool).at[starts].set(True),
        jnp.zeros_like(grid).at[starts].set(macro_ends),
    )  # fmt: skip
    start = state, drift_state, z0, empty_summary(grid, z0, guided.condition, rows)
    (_, _, z, summary), (trace, path) = jax.lax.scan(step, start, spans)
    return Generation(z, summary, None if trace is None else Trace(grid, *trace), path)
