"""Step acceptance: after each step the discrete values are compared with the theorem's bounds.

A step that lands above a limit is halved, from where it began, with the slope that is known there; after a
few halvings between two grid points it is taken, counted, and the requirement told. Every sample has its own
clock: a batch goes on while one sample is halved, and the few that are not done when most are go on by themselves.
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

LAST = 16  # the last sixteenth of a batch is finished by itself


@dataclass(frozen=True)
class StepGuard:
    """How often a step may be halved between two points of the grid.

    With 0 no step is refused; those that land above a limit are counted, and requirements told, all the same.
    """

    halvings: int = 4

    def __post_init__(self) -> None:
        if self.halvings < 0:
            raise ValueError(f"`halvings` must not be negative; got {self.halvings}.")


class Lane(NamedTuple):
    """One sample under way: the last accepted point, and the point that a step proposes."""

    tau: Float[Array, ""]
    z: Float[Array, "agents dim"]
    slope: Float[Array, "agents dim"]
    proposed_tau: Float[Array, ""]
    proposed_z: Float[Array, "agents dim"]
    goal: Int[Array, ""]  # index of the grid point that comes next; beyond the grid: done
    left: Int[Array, ""]  # halvings left before it
    state: Any  # of the guidance
    reports: GuidanceReport  # at the grid points that were reached
    path: Float[Array, "points agents dim"] | None
    evaluations: Int[Array, ""]
    refused: Int[Array, ""]
    above: Int[Array, ""]


class GuardedSteps(NamedTuple):
    """How a lane is carried over the grid; each accepted point meets its limits, or is counted in `above`."""

    grid: Float[Array, " points"]
    solver: RungeKutta
    guard: StepGuard

    def start(
        self, velocity: Velocity, state: Any, z0: Float[Array, "agents dim"], keep_path: bool
    ) -> Lane:
        """A lane that proposes z(0)."""
        points, none, tau = self.grid.shape[0], jnp.asarray(0), self.grid[0]
        _, shapes = jax.eval_shape(velocity, state, tau, z0)
        reports = jax.tree.map(lambda one: jnp.zeros((points, *one.shape), one.dtype), shapes)
        path = jnp.zeros((points, *z0.shape), z0.dtype) if keep_path else None
        halvings = jnp.asarray(self.guard.halvings)
        return Lane(
            tau, z0, jnp.zeros_like(z0), tau, z0, none, halvings, state, reports, path, none, none, none
        )  # fmt: skip

    def advance(self, velocity: Velocity, landed: Landed, lane: Lane) -> Lane:
        """Evaluates the proposed point, accepts or refuses it, and proposes another; a lane that is done stays."""
        points, active = self.grid.shape[0], self.unfinished(lane)
        slope, report = velocity(lane.state, lane.proposed_tau, lane.proposed_z)
        # Not a number is over, too; no step led to the first point.
        over = ~(report.value <= report.limit) & (lane.proposed_tau > self.grid[0])
        within = ~jnp.any(over)
        accept = active & (within | (lane.left == 0))
        refuse = active & ~accept
        reached = accept & (lane.proposed_tau == self.grid[lane.goal])
        goal = lane.goal + reached
        state = jax.tree.map(
            lambda new, old: jnp.where(accept & ~within, new, old),
            landed(lane.state, lane.proposed_tau, report.value, over),
            lane.state,
        )
        tau = jnp.where(accept, lane.proposed_tau, lane.tau)
        z = jnp.where(accept, lane.proposed_z, lane.z)
        slope = jnp.where(accept, slope, lane.slope)
        ahead = self.grid[jnp.minimum(goal, points - 1)]
        after = jnp.where(refuse, tau + (lane.proposed_tau - tau) / 2, ahead)
        size = after - tau
        moved = self.solver.step(lambda t, x: velocity(state, t, x)[0], tau, z, slope, size)
        spot = jnp.where(reached, lane.goal, points)  # beyond the end: not written
        return Lane(
            tau,
            z,
            slope,
            after,
            moved,
            goal,
            jnp.where(reached, self.guard.halvings, lane.left - refuse),
            state,
            jax.tree.map(lambda kept, new: kept.at[spot].set(new), lane.reports, report),
            None if lane.path is None else lane.path.at[spot].set(z),
            lane.evaluations + active,
            lane.refused + refuse,
            lane.above + (accept & ~within),
        )

    def unfinished(self, lane: Lane) -> Bool[Array, "..."]:
        """Whether there are grid points left to reach; of one lane or of a batch."""
        return lane.goal < self.grid.shape[0]


Advance = Callable[[Any, Lane], Lane]
"""(what a sample is conditioned on, its lane) -> the lane one evaluation later."""


def finish(steps: GuardedSteps, advance: Advance, given: Any, lanes: Lane) -> Lane:
    """Carries a batch of lanes to the end; the few that most of it would wait for are gathered and go on alone.

    Args:
        steps: Grid, scheme and guard.
        advance: One evaluation of one lane.
        given: What each sample is conditioned on, with a leading axis of samples.
        lanes: As `GuardedSteps.start` makes them, with a leading axis of samples.
    """
    few = lanes.goal.shape[0] // LAST

    def until(left: int, given: Any, lanes: Lane) -> Lane:
        return jax.lax.while_loop(
            lambda lanes: jnp.sum(steps.unfinished(lanes)) > left,
            lambda lanes: jax.vmap(advance)(given, lanes),
            lanes,
        )

    lanes = until(few, given, lanes)
    if not few:
        return lanes
    last = jnp.argsort(lanes.goal)[:few]  # all that are unfinished are among them
    part = jax.tree.map(lambda leaf: leaf[last], (given, lanes))
    return jax.tree.map(lambda leaf, new: leaf.at[last].set(new), lanes, until(0, *part))
