"""The compiled part of an agent: what it finds at a point by itself, and what the team makes of all that was said."""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.arguments import checked_grid, checked_start, per_agent
from deggflow.drift import EVERY_STEP, AbstractDrift, Interval, aligned
from deggflow.flow import Field
from deggflow.generation import GUARD, Generation, completed, refined_grid
from deggflow.guidance import DecoupledGuidance, GuidanceReport
from deggflow.guidance.agent import agent_input
from deggflow.guidance.decoupled import report_of
from deggflow.guided_field import GuidedField
from deggflow.shapes import Mask, Scalar, States
from deggflow.solver import EULER
from deggflow.step_guard import GuardedSteps, SampleProgress, StepGuard
from deggflow.trace import Trace, as_accepted

COLUMNS = ("contribution", "ell_norm", "opposed_sine", "input_norm", "active", "row_feasible",
           "qp_infeasible", "drift_nan", "value_nan", "gradient_nan", "input_nan")  # fmt: skip
"""Fields of a `GuidanceReport` of which each agent knows its own entries."""


class Start(NamedTuple):
    """What every agent of a team is given.

    Attributes:
        z0: Initial sample.
        grid: Values of tau.
        macro_starts: Where macro steps of the drift begin, as indices of the grid.
        condition: What field and requirements are conditioned on.
        mask: Which agents are present; None: all.
        stops: tau at which each agent stops; 0 for those that were lost before, infinite for all others.
    """

    z0: States
    grid: Float[Array, " points"]
    macro_starts: Int[Array, " macro_steps"]
    condition: Any
    mask: Mask
    stops: Float[np.ndarray, " agents"]

    @property
    def present(self) -> list[int]:
        """Numbers of the agents that take part: those that are present and were not lost before."""
        moving = self.stops > 0
        there = moving if self.mask is None else moving & np.asarray(self.mask)
        return np.flatnonzero(there).tolist()


class Assessment(NamedTuple):
    """What one agent finds at the proposed point.

    Attributes:
        report: As of the guidance; entries of the agent itself and of those that have stopped are right, and those of
            others are not numbers or meaningless.
        velocity: dz/dtau of the agent itself; not a number for others that move.
        state: Of the guidance, after this point.
        tau: Of the next proposal, if the team decides as this agent alone would.
        z: The agent's own state there.
    """

    report: GuidanceReport
    velocity: States
    state: Any
    tau: Scalar
    z: Float[Array, " dim"]


@runtime_checkable
class AgentProgram(Protocol):
    """What an agent computes with: a `TeamProgram`, or what a simulator of all agents has in its place.

    Attributes:
        guidance: Of the team.
        drift: How often the field is evaluated.
    """

    guidance: DecoupledGuidance
    drift: AbstractDrift

    def first(self, start: Start, /) -> tuple[SampleProgress, Any]:
        """The point z(0), and the state of the drift before it."""

    def begin(self, start: Start, drift: Any, interval: Interval, z: States, /) -> Any:
        """The state of the drift in a macro step that begins at z."""

    def assess(
        self,
        start: Start,
        agent: Any,
        at: SampleProgress,
        drift: Any,
        stops: Float[np.ndarray, " agents"],
        /,
    ) -> Assessment:
        """What one agent finds at the proposed point."""

    def settle(
        self,
        start: Start,
        at: SampleProgress,
        own: Assessment,
        said: Mapping[str, Any],
        heard: Bool[np.ndarray, " agents"],
        /,
    ) -> tuple[SampleProgress, Any]:
        """What the team decides about the point, and the point that it proposes next."""

    def generation(self, start: Start, end: SampleProgress, /) -> Generation:
        """The finished generation."""


class TeamProgram:
    """Field, guidance and steps of a team; every agent has the same copy. Compiled when it is first used.

    Attributes:
        guidance: Of the team.
        drift: How often the field is evaluated.
    """

    def __init__(
        self,
        field: Field,
        guidance: DecoupledGuidance,
        *,
        grid: Float[Array | np.ndarray, " points"] | None = None,
        drift: AbstractDrift = EVERY_STEP,
        guard: StepGuard = GUARD,
        keep_trace: bool = False,
        keep_path: bool = False,
    ) -> None:
        """Explicit Euler steps, as `generate` takes them with the same arguments.

        Raises:
            TypeError: `guidance` or `guard` is of another type: acceptance is what a team decides together.
        """
        if not isinstance(guidance, DecoupledGuidance):
            raise TypeError(
                f"`guidance` must be a `DecoupledGuidance`; got {type(guidance).__name__}."
            )
        if not isinstance(guard, StepGuard):
            raise TypeError(f"`guard` must be a `StepGuard`; got {type(guard).__name__}.")
        self.guidance, self.drift = guidance, drift
        self._field, self._grid, self._guard = field, grid, guard
        self._keep = keep_trace, keep_path
        self.first = eqx.filter_jit(self._first)
        self.assess = eqx.filter_jit(self._assess)
        self.settle = eqx.filter_jit(self._settle)
        self.begin = eqx.filter_jit(self._begin)

    def start(
        self,
        z0: Float[Array | np.ndarray, "agents dim"],
        condition: Any = None,
        mask: Bool[Array | np.ndarray, " agents"] | None = None,
        lost: Collection[int] = (),
    ) -> Start:
        """Checks what the team is given, as `generate` does.

        Args:
            z0: Initial sample.
            condition: What field and requirements are conditioned on.
            mask: Which agents are present; None: all.
            lost: Numbers of agents that were lost before: they stay at z(0), and take no part.

        Raises: as `generate`.
        """
        z0 = checked_start(z0, 2)
        grid, starts = aligned(checked_grid(self._grid, refined_grid, z0), self.drift.macro_grid())
        stops = np.full(len(z0), np.inf, z0.dtype)
        stops[sorted(lost)] = 0.0
        return Start(z0, grid, starts, condition, per_agent("mask", mask, z0, bool), stops)

    def _guided(self, start: Start) -> GuidedField:
        return GuidedField(
            self._field, self.guidance, self.drift, start.grid, start.condition, start.mask, None
        )

    def _steps(self, start: Start) -> GuardedSteps:
        return GuardedSteps(start.grid, EULER, self._guard, *self._keep)

    def _first(self, start: Start) -> tuple[SampleProgress, Any]:
        """Progress of a sample that proposes z(0), and the state of the drift."""
        # A prediction is the same for all: they know z(0). Who was lost before has no part in it.
        before = jnp.where(jnp.asarray(start.stops) > 0, jnp.inf, -1.0)
        z0 = self._guided(start)._replace(stops=before).start(start.z0)
        state = self.guidance.init(z0, start.condition, start.mask)
        rows = len(self.guidance.names)
        sample = self._steps(start).start(rows, state, z0, start.condition)
        return sample, self.drift.init(z0)

    def _begin(self, start: Start, drift: Any, interval: Interval, z: States) -> Any:
        """The state of the drift in a macro step that begins at z."""
        return self.drift.step(self._guided(start).nominal, drift, interval, z)

    def _assess(
        self,
        start: Start,
        agent: Int[Array | np.ndarray, ""],
        at: SampleProgress,
        drift: Any,
        stops: Float[Array | np.ndarray, " agents"],
    ) -> Assessment:
        """What one agent finds at the proposed point, from all states and its own drift."""
        number, assessments = jnp.asarray(agent), []

        def velocity(state: Any, step: Int[Array, ""], tau: Scalar, z: States) -> Any:
            step = jnp.minimum(step, len(start.grid) - 2)
            interval = start.grid[step], start.grid[step + 1]
            own = self.drift.value(self._guided(start).nominal, drift, interval, tau, z)[agent]
            moving = tau < stops if start.mask is None else start.mask & (tau < stops)
            alone = agent_input(self.guidance, state, number, tau, z, own, start.condition, moving)
            others = jnp.where(moving, jnp.nan, 0.0)[:, None].astype(z.dtype)
            u = jnp.broadcast_to(others, (len(z), len(alone.u))).at[agent].set(alone.u)
            # Who has stopped can meet rows only if they ask for nothing.
            feasible = jnp.all(alone.rows.b <= 0, axis=0).at[agent].set(alone.feasible)
            drifts = jnp.broadcast_to(others, z.shape).at[agent].set(own)
            report = report_of(alone.rows, u.astype(z.dtype), feasible, drifts)
            slope = drifts.at[agent].set(own + alone.correction)
            assessments.append((report, slope, state))
            return state, slope, report

        alone = self._steps(start).advance(velocity, self.guidance.on_forced_step, start.mask, at)
        report, slope, state = assessments[0]
        return Assessment(report, slope, state, alone.proposed_tau, alone.proposed_z[agent])

    def _settle(
        self,
        start: Start,
        at: SampleProgress,
        own: Assessment,
        said: Mapping[str, Array | np.ndarray],
        heard: Bool[Array | np.ndarray, " agents"],
    ) -> tuple[SampleProgress, Bool[Array, ""]]:
        """What the team decides about the point, and the point that it proposes next.

        Args:
            start: What the team was given.
            at: Where the team is.
            own: What this agent found.
            said: All agents' messages by the names of their fields, with a leading axis of agents.
            heard: Whose messages there are.

        Returns:
            The progress of the team, and whether all agents' proposals belong to the decision. Where they don't, the
            states of others in the proposal are not numbers.
        """
        report = self._merged(own.report, said, heard)
        steps = self._steps(start)
        ahead = steps.advance(
            lambda *_: (own.state, own.velocity, report),
            self.guidance.on_forced_step, start.mask, at,
        )  # fmt: skip
        done = ahead.goal >= len(start.grid)
        meant = done | jnp.all(~heard | (said["tau"] == ahead.proposed_tau))
        here = heard[:, None] & ~done
        proposed_z = jnp.where(here, said["z"], jnp.where(done, ahead.z, ahead.proposed_z))
        ahead = ahead._replace(proposed_z=proposed_z)
        return ahead._replace(value_slope=self._slope(start, ahead)), meant

    def _slope(self, start: Start, at: SampleProgress) -> Float[Array, " rows"]:
        """Slope of the values along the proposed step: nobody has to tell an input for it."""
        size = at.proposed_tau - at.tau
        along = (at.proposed_z - at.z) / jnp.where(size > 0, size, 1.0)
        along = jnp.where(jnp.isfinite(along), along, 0.0)
        _, slope = jax.jvp(
            lambda tau, z: self.guidance.values(tau, z, start.condition, start.mask),
            (at.tau, at.z), (jnp.ones_like(at.tau), along),
        )  # fmt: skip
        return jnp.where(size > 0, slope, at.value_slope)

    def _merged(
        self,
        report: GuidanceReport,
        said: Mapping[str, Array | np.ndarray],
        heard: Bool[Array | np.ndarray, " agents"],
    ) -> GuidanceReport:
        """The report of the whole team; of a value that agents round apart, the worst."""
        of_rows = heard[:, None]

        def merged(name: str) -> Array:
            old, new = getattr(report, name), jnp.moveaxis(said[name], 0, -1)
            return jnp.where(heard if old.ndim == 1 else heard[None], new, old)

        value = jnp.max(jnp.where(of_rows, said["value"], -jnp.inf), axis=0)
        limit = jnp.min(jnp.where(of_rows, said["limit"], jnp.inf), axis=0)
        told = {name: merged(name) for name in COLUMNS}
        return report._replace(value=value, limit=limit, **told)

    def generation(self, start: Start, end: SampleProgress) -> Generation:
        """The finished sample, as `generate` returns it."""
        summary, kept = as_accepted(end.summary, end.trace)
        trace = None if kept is None else Trace(start.grid, *kept)
        whole = Generation(end.z, summary, trace, end.path)
        return completed(whole, self.guidance, self.drift, EULER)
