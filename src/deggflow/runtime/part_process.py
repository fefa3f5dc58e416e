"""The process of several agents of a large team: rounds in which it is told the states of its neighbours alone."""

from hashlib import blake2b
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.identity import fingerprint, requirement_numbers
from deggflow.step_guard import SampleProgress

from .agent import TeamGeneration
from .agreement import DisagreementError
from .exchange import Exchange
from .part import PartProgram, TeamSums, within_links


def owners_of(agents: int, processes: int) -> Int[np.ndarray, " agents"]:
    """Whose agents are whose: equal parts of the team, in the agents' order."""
    return np.arange(agents) * processes // max(agents, 1)


class PartStart(NamedTuple):
    """What a process is told before it generates its part of a sample.

    Attributes:
        number: Of this process.
        owners: Number of the process that each agent belongs to; -1 for those that are absent.
        z0: Initial sample, known to all.
        condition: What field and requirements are conditioned on.
    """

    number: int
    owners: Int[np.ndarray, " agents"]
    z0: Float[Array | np.ndarray, "agents dim"]
    condition: Any


def run_part(
    program: PartProgram, start: PartStart, exchange: Exchange, *, patience: float
) -> TeamGeneration:
    """Generates a sample with the other processes; each has the whole sample in the end.

    Args:
        program: The same in all processes.
        start: The same in all processes, but for `number`.
        exchange: With the other processes.
        patience: Seconds to wait for processes that have not begun.

    Raises:
        TeamError: A process was lost, or was given something else.
    """
    return _Part(program, start, exchange).generate(patience)


def compile_part(program: PartProgram, start: PartStart) -> None:
    """Compiles all that a process runs before others wait for it."""
    number, owners, z0, condition = start
    own, present = jnp.asarray(owners == number), jnp.asarray(owners >= 0)
    z = program.predict(jnp.asarray(z0), condition, present)
    at = program.begin(z, condition, present)
    program.pairs(z, condition)
    program.way(z, z, condition)
    part = program.assess(at, z, condition, present, own)
    jax.block_until_ready(program.settle(at, part, TeamSums.nothing(z.dtype), own, present))


class _Part:
    """One generation in one process."""

    def __init__(self, program: PartProgram, start: PartStart, exchange: Exchange) -> None:
        number, owners, z0, condition = start
        self._program, self._number, self._owners = program, number, owners
        self._own, self._present = owners == number, owners >= 0
        self._mine, self._there = jnp.asarray(self._own), jnp.asarray(self._present)
        self._z0, self._condition, self._exchange = jnp.asarray(z0), condition, exchange
        kind = np.dtype(self._z0.dtype).newbyteorder("<")
        numbers = ("tau", *TeamSums._fields[:-1])
        self._scalars = np.dtype([*((name, kind) for name in numbers), ("active", "u1"), ("moved", "u1")])  # fmt: skip
        self._states = kind
        self._listed_at = self._known = self._seen = np.zeros(0)
        self._needed: dict[int, np.ndarray] = {}

    def generate(self, patience: float) -> TeamGeneration:
        """From z(0) to the end."""
        program = self._program
        z = np.asarray(program.predict(self._z0, self._condition, self._there))
        z = self._states_of_all(z, self._digest(), patience)
        self._list_neighbours(z)
        at = program.begin(jnp.asarray(z), self._condition, self._there)
        while int(at.goal) < len(program.grid):
            at = self._round(at)
        made = program.generation(self._whole(at))
        self._exchange.finish()
        return TeamGeneration(
            jax.tree.map(np.asarray, made), np.full(len(z), np.inf, self._z0.dtype)
        )

    def _digest(self) -> bytes:
        """What all processes must have been given alike."""
        digest = blake2b(digest_size=8)
        condition = fingerprint(self._condition, self._z0.dtype)
        numbers = requirement_numbers(self._program.guidance.requirements)
        for part in (self._z0, self._program.grid, self._owners, condition, numbers):
            digest.update(np.ascontiguousarray(part).tobytes())
        return digest.digest()

    def _round(self, at: SampleProgress) -> SampleProgress:
        """Evaluates the proposed point, and decides with the others what follows."""
        program, mine, present = self._program, self._mine, self._there
        z = jnp.where(mine[:, None], at.proposed_z, self._seen)
        part = program.assess(at, z, self._condition, jnp.asarray(self._known), mine)
        nothing = TeamSums.nothing(z.dtype)
        alone = program.settle(at, part, nothing, mine, present)  # as if the point were accepted
        told = self._tell(part.sums, alone)
        sums = TeamSums.of_all([self._sums(told[k][0]) for k in sorted(told)])
        ahead = program.settle(at, part, sums, mine, present)
        if float(ahead.proposed_tau) != float(alone.proposed_tau):
            told = self._tell(part.sums, ahead)
        if any(float(line["tau"]) != float(ahead.proposed_tau) for line, _ in told.values()):
            raise DisagreementError("processes propose different points.")
        if any(line["moved"] for line, _ in told.values()):
            self._list_neighbours(self._states_of_all(np.asarray(ahead.proposed_z)))
            return ahead
        for other in self._exchange.others:
            self._seen[self._known & (self._owners == other)] = told[other][1]
        return ahead

    def _tell(self, sums: TeamSums, ahead: SampleProgress) -> dict[int, tuple[Any, np.ndarray]]:
        """Tells sums and states of the next point, of these what each process needs; returns what all tell."""
        z = np.asarray(ahead.proposed_z)
        way = self._program.way(jnp.asarray(self._listed_at), ahead.proposed_z, self._condition)
        line = np.zeros((), self._scalars)
        line["tau"], line["active"] = ahead.proposed_tau, sums.active
        line["value"], line["slope"], line["largest"] = sums.value, sums.slope, sums.largest
        line["moved"] = np.any(np.asarray(way)[self._own] > self._program.neighbourhood.skin / 2)
        told = self._exchange.swap(
            {k: line.tobytes() + self._encoded(z[needed]) for k, needed in self._needed.items()}
        )
        heard = {k: self._parsed(k, data) for k, data in told.items()}
        return {self._number: (line, z[:0]), **heard}

    def _parsed(self, sender: int, data: bytes) -> tuple[Any, np.ndarray]:
        size = self._scalars.itemsize
        expected = int(np.sum(self._known & (self._owners == sender)))
        states = self._decoded(sender, data[size:], expected)
        return np.frombuffer(data[:size], self._scalars)[0], states

    def _sums(self, line: Any) -> TeamSums:
        numbers = [jnp.asarray(line[name], self._z0.dtype) for name in TeamSums._fields[:-1]]
        return TeamSums(*numbers, active=jnp.asarray(line["active"], bool))

    def _states_of_all(
        self, z: np.ndarray, digest: bytes = b"", patience: float | None = None
    ) -> np.ndarray:
        """All agents' states; each process tells those of its own to all others."""
        message = digest + self._encoded(z[self._own])
        told = self._exchange.swap(dict.fromkeys(self._exchange.others, message), patience)
        whole = z.copy()
        for other, data in told.items():
            if not data.startswith(digest):
                raise DisagreementError(
                    f"process {other} was given another scene or other settings."
                )
            theirs = self._owners == other
            whole[theirs] = self._decoded(other, data[len(digest) :], int(np.sum(theirs)))
        return whole

    def _encoded(self, states: np.ndarray) -> bytes:
        return np.ascontiguousarray(states, self._states).tobytes()

    def _decoded(self, sender: int, data: bytes, count: int) -> np.ndarray:
        width = self._z0.shape[1]
        if len(data) != count * width * self._states.itemsize:
            raise DisagreementError(
                f"process {sender} told {len(data)} bytes of states; expected {count} states of {width} numbers."
            )
        return np.frombuffer(data, self._states).reshape(count, width)

    def _list_neighbours(self, z: np.ndarray) -> None:
        """Lists from all states who has to be told of whom until an agent has come half of the skin; forgets all others."""
        pairs, complete = self._program.pairs(jnp.asarray(z), self._condition)

        def near(process: int) -> Bool[np.ndarray, " agents"]:
            if not bool(complete):
                return self._present
            return within_links(pairs, self._owners == process)

        self._known = near(self._number)
        self._listed_at, self._seen = z, np.where(self._known[:, None], z, 0.0)
        self._needed = {k: near(k) & self._own for k in self._exchange.others}

    def _whole(self, end: SampleProgress) -> SampleProgress:
        """The end, with every agent's entries as its own process has them; the worst of what is of the team."""
        summary = end.summary
        worst = np.array(
            [summary.smallest_ell_norm[0], summary.least_opposed_sine, -summary.largest_step],
            self._states,
        )  # fmt: skip
        table = _table(end)
        message = worst.tobytes() + self._encoded(table[self._own])
        told = self._exchange.swap(dict.fromkeys(self._exchange.others, message))
        for other, data in told.items():
            theirs = np.frombuffer(data[: worst.nbytes], self._states)
            worst = np.minimum(worst, theirs)
            lines = np.frombuffer(data[worst.nbytes :], self._states)
            table[self._owners == other] = lines.reshape(-1, table.shape[1])
        ell_norm, sine, step = worst.astype(self._z0.dtype)
        whole = _from_table(end, table)
        return whole._replace(
            summary=whole.summary._replace(
                smallest_ell_norm=jnp.asarray([ell_norm]),
                least_opposed_sine=jnp.asarray(sine),
                largest_step=jnp.asarray(-step),
            )
        )


def _of_agents(end: SampleProgress) -> tuple[Any, ...]:
    """What a summary has of each agent; the axis of agents comes last."""
    summary = end.summary
    return (
        summary.largest_input_norm, summary.infeasible_points, summary.qp_infeasible_points,
        summary.forced_steps, *summary.nan,
    )  # fmt: skip


def _table(end: SampleProgress) -> Float[np.ndarray, "agents columns"]:
    """State and summary of each agent, one line each."""
    rows = [np.atleast_2d(np.asarray(leaf)) for leaf in _of_agents(end)]
    return np.concatenate([np.asarray(end.z).T, *rows], dtype=end.z.dtype).T


def _from_table(end: SampleProgress, table: Float[np.ndarray, "agents columns"]) -> SampleProgress:
    z, rows = table[:, : end.z.shape[1]], table[:, end.z.shape[1] :].T
    leaves, at = [], 0
    for leaf in _of_agents(end):
        count = leaf.size // leaf.shape[-1]
        leaves.append(rows[at : at + count].reshape(leaf.shape).astype(leaf.dtype))
        at += count
    whole = eqx.tree_at(_of_agents, end, tuple(leaves))
    return whole._replace(z=z, summary=whole.summary._replace(z=z))
