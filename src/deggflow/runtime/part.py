"""Several agents of a large team in one process, which is told the states of its neighbours alone.

Who the neighbours are is known from a list of the pairs of agents that may bind one another before some agent has come a
given way. All processes make the same list, from the states of all, and make it again once an agent has come half of that way:
as Verlet lists of molecular dynamics. Between lists a process sends to another one the states of those of its agents
that are within three links of the other's agents. No row depends on any other state (docs/theory.md, section 2).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.drift import AbstractDrift, AfterPrediction
from deggflow.flow import Field
from deggflow.generation import Generation, completed
from deggflow.guidance import (
    DecoupledGuidance,
    GuidanceReport,
    Local,
    Own,
    Pairs,
    PrivateRequirement,
)
from deggflow.guidance.decoupled import report_of
from deggflow.guided_field import GuidedField
from deggflow.shapes import States
from deggflow.solver import EULER
from deggflow.step_guard import GuardedSteps, SampleProgress, StepGuard
from deggflow.trace import Trace, as_accepted

LINKS = 3

Flags = Bool[Array, " agents"]


@runtime_checkable
class Neighbourhood(Protocol):
    """What tells which agents of a condition may bind one another."""

    skin: float
    """The way, in any unit, that two agents may come towards each other before the pairs are listed again."""

    def pairs(self, z: States, condition: Any, /) -> tuple[Pairs, Bool[Array, ""]]:
        """Pairs that may bind before two agents have come `skin` closer, and whether all were found."""

    def way(self, before: States, after: States, condition: Any, /) -> Float[Array, " agents"]:
        """The most by which any point of each agent has moved, in the unit of `skin`."""

    def only(self, known: Flags, condition: Any, /) -> Any:
        """The condition in which no others are present."""


class TeamSums(NamedTuple):
    """What a process says of its own agents at a point, or all together of the team.

    Attributes:
        value: Sum of their contributions to V.
        slope: Their part of dV/dtau.
        largest: Largest contribution.
        active: Whether the row decides the input of one of them.
    """

    value: Float[Array, ""]
    slope: Float[Array, ""]
    largest: Float[Array, ""]
    active: Bool[Array, ""]

    @staticmethod
    def nothing(dtype: Any) -> "TeamSums":
        """Of no agent: no limit is exceeded by it."""
        zero = jnp.zeros((), dtype)
        return TeamSums(zero, zero, zero, jnp.asarray(False))

    @staticmethod
    def of_all(parts: Sequence["TeamSums"]) -> "TeamSums":
        """Of the team, from those of all processes in order: the same numbers in all."""
        value, slope, largest, active = (np.stack(each) for each in zip(*parts, strict=True))
        # One after the other: not in an order that a library may choose.
        sums = (np.add.accumulate(each)[-1] for each in (value, slope))
        return TeamSums(*map(jnp.asarray, (*sums, np.max(largest), np.any(active))))


class OwnPart(NamedTuple):
    """What a process finds at a point.

    Attributes:
        report: Entries of its own agents are right; of the others they say nothing.
        slope: dz/dtau of its own agents; zero for others.
        sums: Of its own agents.
    """

    report: GuidanceReport
    slope: States
    sums: TeamSums


class PartProgram:
    """What a process computes of its own agents; compiled when it is first used.

    Attributes:
        guidance: Of the team.
        neighbourhood: Who may bind whom.
    """

    def __init__(
        self,
        field: Field,
        guidance: DecoupledGuidance,
        neighbourhood: Neighbourhood,
        *,
        grid: Float[Array | np.ndarray, " points"],
        drift: AbstractDrift,
        guard: StepGuard,
        keep_trace: bool = False,
    ) -> None:
        """Explicit Euler steps, as `generate` takes them with the same arguments.

        Raises:
            TypeError: `drift` is of another type: a field that acts throughout would need the states of neighbours' neighbours.
            ValueError: An agent's rows would depend on states that it is not told.
        """
        if not isinstance(drift, AfterPrediction):
            raise TypeError(f"`drift` must be an `AfterPrediction`; got {type(drift).__name__}.")
        self._requirement = _local_requirement(guidance)
        self.guidance, self.neighbourhood = guidance, neighbourhood
        self._field, self._drift = field, drift
        self.grid = jnp.asarray(grid)
        self._steps = GuardedSteps(self.grid, EULER, guard, keep_trace, False)
        self.predict = eqx.filter_jit(self._predict)
        self.begin = eqx.filter_jit(self._begin)
        self.pairs = eqx.filter_jit(neighbourhood.pairs)
        self.way = eqx.filter_jit(neighbourhood.way)
        self.assess = eqx.filter_jit(self._assess)
        self.settle = eqx.filter_jit(self._settle)

    def _predict(self, z0: States, condition: Any, mask: Flags) -> States:
        """The nominal sample of z(0): all processes know z(0), so nobody has to tell a state for it."""
        guided = GuidedField(
            self._field, self.guidance, self._drift, self.grid, condition, mask, None
        )
        return guided.start(z0)

    def _begin(self, z: States, condition: Any, mask: Flags) -> SampleProgress:
        """Progress of a sample that proposes the prediction."""
        state = self.guidance.init(z, condition, mask)
        return self._steps.start(len(self.guidance.names), state, z, condition)

    def _assess(
        self,
        at: SampleProgress,
        z: States,
        condition: Any,
        known: Flags,
        own: Flags,
    ) -> OwnPart:
        """What a process finds at the proposed point.

        Args:
            at: Where the team is.
            z: States of the agents that are known; of the others anything finite.
            condition: Of the team.
            known: Whose states are known.
            own: Whose process this is.
        """
        some = self.neighbourhood.only(known, condition)
        drift = jnp.where(
            own[:, None], z - z, 0.0
        )  # not a number where the prediction is not finite
        rows = self.guidance.rows(at.state, at.proposed_tau, z, drift, some, known)
        inputs = jax.vmap(self.guidance.solve, in_axes=(1, 1, None))(rows.ell, rows.b, None)
        u = jnp.where(own[:, None], inputs.u, 0.0).astype(z.dtype)
        report = report_of(rows, u, inputs.feasible | ~own, drift)
        (part,), (active,) = report.contribution, report.active
        sums = TeamSums(
            jnp.sum(jnp.where(own, part, 0.0)), report.slope[0],
            jnp.max(jnp.where(own, part, 0.0)), jnp.any(active & own),
        )  # fmt: skip
        return OwnPart(report, u, sums)

    def _settle(
        self,
        at: SampleProgress,
        part: OwnPart,
        sums: TeamSums,
        own: Flags,
        mask: Flags,
    ) -> SampleProgress:
        """What the team decides about the proposed point, from the sums of all, and the point that it proposes next."""
        report = self._of_team(at, part.report, sums, own)
        return self._steps.advance(
            lambda *_: (at.state, part.slope, report), self.guidance.on_forced_step, mask, at
        )

    def _of_team(
        self,
        at: SampleProgress,
        report: GuidanceReport,
        sums: TeamSums,
        own: Flags,
    ) -> GuidanceReport:
        """The report of the whole team, in which entries of others stand for the rest of it."""
        (state,), requirement = at.state, self._requirement
        tau = at.proposed_tau
        # Where the bound starts, it is this value.
        state = state._replace(anchor=jnp.where(tau == state.since, sums.value, state.anchor))
        row = own[None]  # there is one
        return GuidanceReport(
            value=sums.value[None],
            bound=requirement.bound(state, tau)[None],
            limit=requirement.limit(state, tau)[None],
            slope=sums.slope[None],
            contribution=jnp.where(row, report.contribution, sums.largest),
            active=jnp.where(row, report.active, sums.active),
            ell_norm=jnp.where(row, report.ell_norm, jnp.inf),
            opposed_sine=jnp.where(own, report.opposed_sine, 1.0),
            input_norm=jnp.where(own, report.input_norm, 0.0),
            row_feasible=report.row_feasible | ~row,
            qp_infeasible=report.qp_infeasible & own,
            drift_nan=report.drift_nan & own,
            value_nan=report.value_nan & row,
            gradient_nan=report.gradient_nan & row,
            input_nan=report.input_nan & own,
        )

    def generation(self, end: SampleProgress) -> Generation:
        """The finished sample, as `generate` returns it."""
        summary, kept = as_accepted(end.summary, end.trace)
        trace = None if kept is None else Trace(self.grid, *kept)
        whole = Generation(end.z, summary, trace, None)
        return completed(whole, self.guidance, self._drift, EULER)


def _local_requirement(guidance: DecoupledGuidance) -> PrivateRequirement:
    """The only requirement; raises `ValueError` unless its rows depend on agents within three links alone."""
    only = guidance.requirements[0]
    if (
        len(guidance.requirements) > 1
        or not isinstance(only, PrivateRequirement)
        or not only.per_owner_gain
        or not isinstance(only.allocation, Local | Own)
    ):
        raise ValueError(
            "`guidance` must have one `PrivateRequirement` with `per_owner_gain=True` and `Local()` or `Own()`, "
            f"as every other one depends on the whole team; got {', '.join(guidance.names)}."
        )
    if guidance.control is not None or guidance.metric is not None:
        raise ValueError("`guidance` must have neither `control` nor `metric`.")
    return only


def within_links(pairs: Pairs, some: Bool[np.ndarray, " agents"]) -> Bool[np.ndarray, " agents"]:
    """Who is at most three links from some agents, these included."""
    active = np.asarray(pairs.active)
    one, other = np.asarray(pairs.owner)[active], np.asarray(pairs.agent)[active]
    near = some.copy()
    for _ in range(LINKS):
        wider = near.copy()
        wider[other[near[one]]] = True
        wider[one[near[other]]] = True
        near = wider
    return near
