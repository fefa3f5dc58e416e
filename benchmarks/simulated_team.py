"""A team's program for agents that are simulated in one process: what all compute of one point is computed in one call.

Agents are told apart by their inputs alone. Those that have come to a point by the same messages have one compiled call for
all of them, in which the program runs once for each, one after the other; an agent that was told anything else has a call of
its own. So agents that would disagree disagree here, too.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class _Together(NamedTuple):
    """What all agents computed from the same inputs: stacked for the next call, and each agent's part."""

    stacked: Any
    parts: list


class CompiledTeam:
    """Compiled programs of a `TeamProgram` for all agents at once; one for all generations of a size.

    Attributes:
        program: The `TeamProgram`.
        agents: How many there are.
    """

    def __init__(self, program, agents):
        self.program, self.agents = program, agents
        self.first = jax.jit(program._first)
        self.begin = jax.jit(program._begin)
        self.assess = jax.jit(self._assess)
        self.settle = jax.jit(self._settle)

    def _assess(self, start, samples, drift, stops):
        def one(each):
            number, sample = each
            return self.program._assess(start, number, sample, drift, stops)

        return jax.lax.map(one, (jnp.arange(self.agents), samples))

    def _settle(self, start, samples, own, said, heard):
        def one(each):
            return self.program._settle(start, *each, said, heard)

        return jax.lax.map(one, (samples, own))


class SimulatedProgram:
    """The program of one generation; agents call it as they call a `TeamProgram`."""

    def __init__(self, compiled):
        """Args: compiled: a `CompiledTeam`."""
        self._compiled = compiled
        self.guidance, self.drift = compiled.program.guidance, compiled.program.drift
        self.start = compiled.program.start
        self._known, self._whose, self._kept = {}, {}, []

    def first(self, start):
        """As of `TeamProgram`, and so are the others."""

        def shared():
            sample, drift = self._compiled.first(start)
            stacked = jax.tree.map(self._repeated, sample)
            return self._together(stacked), drift

        together, drift = self._once(("first",), shared)
        # Each caller is another agent, and takes the next part.
        number = self._known.setdefault("callers", 0)
        self._known["callers"] = number + 1
        return together.parts[number], drift

    def _repeated(self, leaf):
        return jnp.broadcast_to(leaf, (self._compiled.agents, *jnp.shape(leaf)))

    def begin(self, start, drift, interval, z):
        key = "begin", id(drift), *(float(end) for end in interval), np.asarray(z).tobytes()
        return self._once(key, lambda: self._compiled.begin(start, drift, interval, z))

    def assess(self, start, number, sample, drift, stops):
        samples, mine = self._whose[id(sample)]
        assert mine == number
        key = "assess", id(samples), id(drift), stops.tobytes()
        together = self._once(
            key,
            lambda: self._together(self._compiled.assess(start, samples.stacked, drift, stops)),
        )
        return together.parts[mine]

    def settle(self, start, sample, own, said, heard):
        samples, mine = self._whose[id(sample)]
        found, same = self._whose[id(own)]
        assert mine == same
        told = b"".join(entry.tobytes() for entry in said.values())
        key = "settle", id(samples), id(found), heard.tobytes(), told

        def shared():
            result = self._compiled.settle(start, samples.stacked, found.stacked, said, heard)
            ahead, meant = result
            return self._together(ahead), np.asarray(meant)

        together, meant = self._once(key, shared)
        return together.parts[mine], meant[mine]

    def generation(self, start, end):
        return self._compiled.program.generation(start, jax.tree.map(jnp.asarray, end))

    def _once(self, key, compute):
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]

    def _together(self, stacked):
        leaves, tree = jax.tree.flatten(stacked)
        plain = [np.asarray(leaf) for leaf in leaves]
        agents = range(self._compiled.agents)
        parts = [jax.tree.unflatten(tree, [leaf[k] for leaf in plain]) for k in agents]
        together = _Together(stacked, parts)
        self._kept.append(together)  # what is told by its identity must live on
        for k, part in enumerate(parts):
            self._whose[id(part)] = together, k
        return together
