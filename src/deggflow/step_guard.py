"""Step acceptance: after each step the discrete values are compared with the theorem's bounds.

A step that lands above a limit is halved, from where it began, with the slope that is known there; after a
few halvings between two grid points it is taken, counted, and the requirement told. Every sample has its own
clock: a batch goes on while one sample is halved.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .guidance import GuidanceReport
from .solver import RungeKutta

Velocity = Callable[
    [Any, Float[Array, ""], Float[Array, "agents dim"]],
    tuple[Float[Array, "agents dim"], GuidanceReport],
]
"""(state of the guidance, tau, z) -> dz/dtau and what the guidance reports."""

Landed = Callable[[Any, Float[Array, ""], Float[Array, " rows"], Bool[Array, " rows"]], Any]


@dataclass(frozen=True)
class StepGuard:
    """How often a step may be halved between two points of the grid."""

    halvings: int = 4

    def __post_init__(self) -> None:
        if self.halvings < 1:
            raise ValueError(
                f"`halvings` must be at least 1; got {self.halvings}. Without a guard steps are fixed."
            )


class _Lane(NamedTuple):
    """One sample under way: the last accepted point, and the point that a step proposes."""

    tau: Float[Array, ""]
    z: Float[Array, "agents dim"]
    slope: Float[Array, "agents dim"]
    proposed_tau: Float[Array, ""]
    proposed_z: Float[Array, "agents dim"]
    goal: Int[Array, ""]  # index of the grid point that comes next
    left: Int[Array, ""]  # halvings left before it
    state: Any  # of the guidance
    reports: GuidanceReport  # at the grid points that were reached
    path: Float[Array, "points agents dim"] | None
    evaluations: Int[Array, ""]
    refused: Int[Array, ""]
    above: Int[Array, ""]


def guarded_steps(
    velocity: Velocity,
    landed: Landed,
    state: Any,
    z0: Float[Array, "agents dim"],
    grid: Float[Array, " points"],
    solver: RungeKutta,
    guard: StepGuard,
    keep_path: bool,
) -> _Lane:
    """Carries z(0) over the grid; each accepted point meets its limits, or is counted in `above`."""
    points = grid.shape[0]
    start = _start(velocity, state, z0, grid, guard, keep_path)

    def body(lane: _Lane) -> _Lane:
        slope, report = velocity(lane.state, lane.proposed_tau, lane.proposed_z)
        # Not a number is over, too; no step led to the first point.
        over = ~(report.value <= report.limit) & (lane.proposed_tau > grid[0])
        within = ~jnp.any(over)
        accept = within | (lane.left == 0)
        reached = accept & (lane.proposed_tau == grid[lane.goal])
        goal = lane.goal + reached
        state = jax.tree.map(
            lambda new, old: jnp.where(accept & ~within, new, old),
            landed(lane.state, lane.proposed_tau, report.value, over),
            lane.state,
        )
        tau = jnp.where(accept, lane.proposed_tau, lane.tau)
        z = jnp.where(accept, lane.proposed_z, lane.z)
        slope = jnp.where(accept, slope, lane.slope)
        ahead = grid[jnp.minimum(goal, points - 1)]
        after = jnp.where(accept, ahead, tau + (lane.proposed_tau - tau) / 2)
        moved = solver.step(lambda t, x: velocity(state, t, x)[0], tau, z, slope, after - tau)
        spot = jnp.where(reached, lane.goal, points)  # beyond the end: not written
        return _Lane(
            tau,
            z,
            slope,
            after,
            moved,
            goal,
            jnp.where(reached, guard.halvings, lane.left - ~accept),
            state,
            jax.tree.map(lambda kept, new: kept.at[spot].set(new), lane.reports, report),
            None if lane.path is None else lane.path.at[spot].set(z),
            lane.evaluations + 1,
            lane.refused + ~accept,
            lane.above + (accept & ~within),
        )

    return jax.lax.while_loop(lambda lane: lane.goal < points, body, start)


def _start(
    velocity: Velocity,
    state: Any,
    z0: Float[Array, "agents dim"],
    grid: Float[Array, " points"],
    guard: StepGuard,
    keep_path: bool,
) -> _Lane:
    points, none = grid.shape[0], jnp.asarray(0)
    _, shapes = jax.eval_shape(velocity, state, grid[0], z0)
    reports = jax.tree.map(lambda one: jnp.zeros((points, *one.shape), one.dtype), shapes)
    path = jnp.zeros((points, *z0.shape), z0.dtype) if keep_path else None
    return _Lane(
        grid[0], z0, jnp.zeros_like(z0), grid[0], z0, none, jnp.asarray(guard.halvings),
        state, reports, path, none, none, none,
    )  # fmt: skip
