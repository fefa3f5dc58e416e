"""Algorithm 1: guided generation, of one sample or of many."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .flow import Field
from .guidance import AbstractGuidance, GuidanceReport
from .solver import EULER, RungeKutta
from .step_guard import GuardedSteps, Lane, StepGuard, Velocity, finish
from .trace import Trace, Work

DEFAULT_STEPS = 100


class Generation(NamedTuple):
    """A generated sample."""

    z: Float[Array, "agents dim"]
    trace: Trace
    path: Float[Array, "points agents dim"] | None  # z at every grid point, if it was asked for
    work: Work


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
    z0: Float[Array, "agents dim"],
    condition: Any,
    *,
    grid: Float[Array, " points"] | None = None,
    solver: RungeKutta = EULER,
    guard: StepGuard | None = None,
    stops: Float[Array, " agents"] | None = None,
    keep_path: bool = False,
) -> Generation:
    """Carries z(0) to z(1) under the nominal field and the guidance, by explicit steps on the grid.

    Args:
        field: Nominal vector field, any callable (tau, z, condition) -> dz/dtau.
        guidance: `DecoupledGuidance`, or `NoGuidance` for the nominal sample.
        z0: Initial sample.
        condition: What field and requirements are conditioned on, any pytree.
        grid: Increasing values of tau from 0 to 1; `refined_grid()` by default.
        solver: `EULER`, `HEUN` or `RK4`.
        guard: Compares every step with its limits and halves those that fail; None for fixed steps.
        stops: tau at which each agent stops for good (u_i = 0, dz_i/dtau = 0); None if all of them move.
        keep_path: Also return z at every grid point.

    Source: paper, alg:guided_sampling.
    """
    grid = refined_grid() if grid is None else grid
    velocity, state = _velocity(field, guidance, condition, stops), guidance.init(z0, condition)
    if guard is None:
        return _fixed_steps(velocity, state, z0, grid, solver, keep_path)
    steps = GuardedSteps(grid, solver, guard)
    end = jax.lax.while_loop(
        steps.unfinished,
        lambda lane: steps.advance(velocity, guidance.landed, lane),
        steps.start(velocity, state, z0, keep_path),
    )
    return _generation(grid, end)


def generate_batch(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array, "samples agents dim"],
    condition: Any,
    *,
    grid: Float[Array, " points"] | None = None,
    solver: RungeKutta = EULER,
    guard: StepGuard | None = None,
    stops: Float[Array, "samples agents"] | None = None,
    keep_path: bool = False,
) -> Generation:
    """`generate` of many samples at once; nothing but the time it takes depends on which are together.

    Under `jax.vmap(generate)` every sample of a batch with guarded steps costs as much as the slowest; here the
    slow ones are gathered and finished by themselves.

    Args: as of `generate`, where `z0`, `stops` and the leaves of `condition` have a leading axis of samples.
    """
    grid = refined_grid() if grid is None else grid
    if guard is None:

        def fixed(z0: Float[Array, "agents dim"], given: tuple[Any, Any]) -> Generation:
            condition, stops = given
            return generate(
                field, guidance, z0, condition,
                grid=grid, solver=solver, stops=stops, keep_path=keep_path,
            )  # fmt: skip

        return jax.vmap(fixed)(z0, (condition, stops))
    steps = GuardedSteps(grid, solver, guard)

    def start(z0: Float[Array, "agents dim"], given: tuple[Any, Any]) -> Lane:
        state = guidance.init(z0, given[0])
        return steps.start(_velocity(field, guidance, *given), state, z0, keep_path)

    def advance(given: tuple[Any, Any], lane: Lane) -> Lane:
        return steps.advance(_velocity(field, guidance, *given), guidance.landed, lane)

    given = (condition, stops)
    end = finish(steps, advance, given, jax.vmap(start)(z0, given))
    return _generation(jnp.broadcast_to(grid, (len(z0), len(grid))), end)


def _generation(tau: Float[Array, "... points"], end: Lane) -> Generation:
    work = Work(end.evaluations, end.refused, end.above)
    return Generation(end.z, Trace(tau, *end.reports), end.path, work)


def _velocity(
    field: Field,
    guidance: AbstractGuidance,
    condition: Any,
    stops: Float[Array, " agents"] | None,
) -> Velocity:
    """dz/dtau of the guided field."""

    def velocity(
        state: Any, tau: Float[Array, ""], z: Float[Array, "agents dim"]
    ) -> tuple[Float[Array, "agents dim"], GuidanceReport]:
        drift = field(tau, z, condition)
        if stops is None:
            correction, report = guidance(state, tau, z, drift, condition)
            return drift + correction, report
        moving = tau < stops
        drift = jnp.where(moving[:, None], drift, 0.0)
        correction, report = guidance(state, tau, z, drift, condition, moving)
        return drift + jnp.where(moving[:, None], correction, 0.0), report

    return velocity


def _fixed_steps(
    velocity: Velocity,
    state: Any,
    z0: Float[Array, "agents dim"],
    grid: Float[Array, " points"],
    solver: RungeKutta,
    keep_path: bool,
) -> Generation:
    def step(
        z: Float[Array, "agents dim"], span: tuple[Float[Array, ""], Float[Array, ""]]
    ) -> tuple[
        Float[Array, "agents dim"], tuple[GuidanceReport, Float[Array, "agents dim"] | None]
    ]:
        tau, after = span
        slope, report = velocity(state, tau, z)
        moved = solver.step(lambda t, x: velocity(state, t, x)[0], tau, z, slope, after - tau)
        # No step follows tau = 1, where some fields are infinite.
        return jnp.where(after > tau, moved, z), (report, z if keep_path else None)

    ahead = jnp.append(grid[1:], grid[-1])
    z, (reports, path) = jax.lax.scan(step, z0, (grid, ahead))
    none = jnp.asarray(0)
    return Generation(z, Trace(grid, *reports), path, Work(jnp.asarray(len(grid)), none, none))
