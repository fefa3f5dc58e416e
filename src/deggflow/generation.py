"""Algorithm 1: guided generation of one sample."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .flow import Field
from .guidance import AbstractGuidance, GuidanceReport
from .solver import EULER, RungeKutta
from .step_guard import StepGuard, Velocity, guarded_steps

DEFAULT_STEPS = 100


class Trace(NamedTuple):
    """The generation before each step; with a step guard at every grid point, tau = 1 included."""

    tau: Float[Array, " points"]
    value: Float[Array, "points rows"]  # V or q of each requirement
    bound: Float[Array, "points rows"]  # what the theorem promises of it
    limit: Float[Array, "points rows"]  # what a discrete step may reach
    able: Bool[Array, "points rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, "points agents"]  # this agent had no input that meets its rows
    effort: Float[Array, "points agents"]  # |u_i|


class Work(NamedTuple):
    """What the generation took."""

    evaluations: Int[Array, ""]  # of the guided field at the points that steps reached
    refused: Int[Array, ""]  # steps that landed above a limit and were halved
    above: Int[Array, ""]  # steps that were taken although they landed above a limit


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
    state = guidance.init(z0, condition)

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

    if guard is not None:
        end = guarded_steps(velocity, guidance.landed, state, z0, grid, solver, guard, keep_path)
        work = Work(end.evaluations, end.refused, end.above)
        return Generation(end.z, Trace(grid, *end.reports), end.path, work)
    return _fixed_steps(velocity, state, z0, grid, solver, keep_path)


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
        return moved, (report, z if keep_path else None)

    z, (reports, path) = jax.lax.scan(step, z0, (grid[:-1], grid[1:]))
    if path is not None:
        path = jnp.concatenate([path, z[None]])
    none = jnp.asarray(0)
    work = Work(jnp.asarray(len(grid) - 1), none, none)
    return Generation(z, Trace(grid[:-1], *reports), path, work)
