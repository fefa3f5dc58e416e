"""One agent of a team: it moves its own state, and hears the states of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from deggflow.certificate import Certificate, GenerationRecord
from deggflow.certification import certify
from deggflow.generation import Generation
from deggflow.guidance import AbstractRequirement, DecoupledGuidance
from deggflow.recording import lost_agents, record
from deggflow.step_guard import SampleProgress

from .messages import RECORD_ONLY, AgentMessage, Layout
from .program import COLUMNS, AgentProgram, Assessment, Start


class TeamGeneration(NamedTuple):
    """A sample that a team has generated.

    Attributes:
        generation: As `generate` returns it; agents that were lost stay where they were.
        stops: tau at which each agent was lost; infinite if it was not.
    """

    generation: Generation
    stops: Float[np.ndarray, " agents"]

    def record(self, names: Sequence[str], agents: Sequence[str] | None = None) -> GenerationRecord:
        """What happened on the way, and who was lost when.

        Args: names: of the requirements; agents: what to call the agents.
        """
        generation = self.generation
        made = record(generation.summary, names, agents, generation.trace)
        return replace(made, lost=lost_agents(self.stops, agents))

    def certify(
        self,
        requirements: DecoupledGuidance | Sequence[AbstractRequirement],
        condition: Any = None,
        *,
        mask: Bool[np.ndarray, " agents"] | None = None,
        agents: Sequence[str] | None = None,
    ) -> Certificate:
        """The certificate, which names who was lost and when.

        Args: as of `deggflow.certify`.
        """
        made = certify(self.generation, requirements, condition, mask=mask, agents=agents)
        assert made.generation is not None
        return replace(
            made, generation=replace(made.generation, lost=lost_agents(self.stops, agents))
        )


class _Progress(NamedTuple):
    """Where the team is, and the agent's drift.

    Attributes:
        sample: The last accepted point, and the proposed one.
        drift: State of the drift.
        macro_steps: How many macro steps have begun.
    """

    sample: SampleProgress
    drift: Any
    macro_steps: int


class Agent:
    """The part of one agent in a generation: a message in each round, from the messages of the round before.

    All that it knows of the others is what their messages say. Agents of a team are given the same program, z(0) and
    condition. It computes, and does nothing else: `Member` carries it through the rounds.

    Attributes:
        number: Of this agent.
        layout: Of its messages.
        generated: The sample, once it is certain that all agents have it; None before.
    """

    def __init__(self, program: AgentProgram, number: int, start: Start) -> None:
        """Args: program: of the team; number: of this agent; start: `program.start(z0, condition)`.

        Raises:
            ValueError: There is no such agent.
        """
        _, dim = start.z0.shape
        if number not in start.present:
            raise ValueError(f"`number` must be one of {start.present}; got {number}.")
        self.number = number
        self.generated: TeamGeneration | None = None
        rows = len(program.guidance.names)
        self.layout = Layout(dim=dim, rows=rows, dtype=start.z0.dtype)
        self._program, self._start = program, start
        self._stops = start.stops.copy()
        self._grid, self._macro_starts = np.asarray(start.grid), np.asarray(start.macro_starts)
        self._at = _Progress(*program.first(start), 0)
        self._accepted = self._at  # in front of the last accepted point
        self._assessed: Assessment | None = None
        self._end: SampleProgress | None = None

    def first_message(self) -> bytes:
        """The message of the first round: of z(0), which all agents know."""
        return self._assess()

    def next_message(self, contents: Mapping[int, bytes]) -> bytes:
        """The message of the next round.

        Args:
            contents: Messages of all agents that are not lost, by their numbers.
        """
        if self._end is not None:
            self._finish()
            return self._last_message()
        said, heard = self._by_agent(contents)
        assert self._assessed is not None
        at, own = self._at, self._assessed
        ahead, meant = self._program.settle(self._start, at.sample, own, said, heard)
        if not bool(meant):
            # Machines may round apart: all propose again, now for what the team decided.
            return self._message(np.asarray(ahead.proposed_tau), ahead.proposed_z[self.number])
        if float(ahead.tau) == float(at.sample.proposed_tau):
            self._accepted = at
        self._at = self._at._replace(sample=ahead)
        if int(ahead.goal) >= len(self._grid):
            self._end = ahead
            return self._last_message()
        return self._assess()

    def message_without(self, lost: frozenset[int]) -> bytes:
        """The message after agents were lost: these stop at the last accepted point, which is assessed again.

        Args:
            lost: Numbers of agents that no longer take part.
        """
        if self._end is not None:
            self._finish()  # all that go on have the end
            return self._last_message()
        self._at = self._accepted
        self._stops[sorted(lost)] = np.asarray(self._at.sample.proposed_tau)
        return self._assess()

    def unfinished(self) -> Generation:
        """The generation as far as it is."""
        made = self._program.generation(self._start, self._at.sample)
        return jax.tree.map(np.asarray, made)

    def _assess(self) -> bytes:
        program, at = self._program, self._at
        drift = self._drift_at_point()
        number = np.asarray(self.number)
        own = program.assess(self._start, number, at.sample, drift, self._stops)
        self._assessed = own
        return self._message(np.asarray(own.tau), own.z)

    def _drift_at_point(self) -> Any:
        """The state of the drift at the proposed point, where a macro step may begin."""
        at, starts = self._at, self._macro_starts
        begun, tau = at.macro_steps, float(at.sample.proposed_tau)
        if not self._program.drift.step_evaluations or begun >= len(starts):
            return at.drift
        if tau < self._grid[starts[begun]]:
            return at.drift
        after = self._grid[starts[begun + 1]] if begun + 1 < len(starts) else self._grid[-1]
        interval = self._start.grid[starts[begun]], jax.numpy.asarray(after)
        drift = self._program.begin(self._start, at.drift, interval, at.sample.proposed_z)
        self._at = at._replace(drift=drift, macro_steps=begun + 1)
        return drift

    def _message(self, tau: Any, z: Any) -> bytes:
        assert self._assessed is not None
        report = jax.tree.map(np.asarray, self._assessed.report)
        column = {name: getattr(report, name)[..., self.number] for name in COLUMNS}
        return self.layout.encode(
            AgentMessage(
                tau=tau,
                z=np.asarray(z),
                value=report.value,
                limit=report.limit,
                last=np.asarray(False),
                **column,
            )
        )

    def _last_message(self) -> bytes:
        assert self._end is not None
        row = np.asarray(self._end.value)
        nothing = {
            name: np.zeros(self.layout.fields[name].shape) for name in (*RECORD_ONLY, "limit")
        }
        z, yes = np.asarray(self._end.z[self.number]), np.asarray(True)
        tau = np.asarray(self._end.tau)
        return self.layout.encode(AgentMessage(tau=tau, z=z, value=row, last=yes, **nothing))

    def _by_agent(
        self, contents: Mapping[int, bytes]
    ) -> tuple[dict[str, np.ndarray], Bool[np.ndarray, " agents"]]:
        """Fields of all messages, and whose there are."""
        heard = np.zeros(len(self._stops), bool)
        heard[list(contents)] = True
        lines = np.zeros(len(heard), self.layout.fields)
        lines[heard] = [np.frombuffer(contents[k], self.layout.fields)[0] for k in sorted(contents)]
        flags = {name: self.layout.fields[name].base == np.uint8 for name in AgentMessage._fields}
        native = self._stops.dtype
        said = {name: lines[name].astype(bool if flags[name] else native) for name in flags}
        return said, heard

    def _finish(self) -> None:
        if self.generated is None:
            assert self._end is not None
            made = self._program.generation(self._start, self._end)
            self.generated = TeamGeneration(jax.tree.map(np.asarray, made), self._stops)
