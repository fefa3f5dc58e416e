"""
# One process for each agent

A generation needs no central program. Each agent runs by itself with a copy of the field and the requirements, tells the
others its state, and computes its own input. Agents may crash; the others agree on who was lost, take over its shares
and finish with one certificate. [The guide](../runtime.md) has messages, fault model and proofs.
"""

# %%
import jax
import jax.numpy as jnp

from deggflow import DecoupledGuidance, refined_grid, requirements
from deggflow.runtime import Fault, Member, Network, Simulation, TeamProgram


def field(tau, z, condition):
    return 2.0 * (0.3 * jnp.roll(z, 1, axis=0) - z)


guidance = DecoupledGuidance((requirements.apart(distance=0.5, buffer=0.05),))
program = TeamProgram(field, guidance, grid=refined_grid(40))
start = program.start(jax.random.normal(jax.random.key(0), (5, 2)))

# %%
# ## A network with faults, simulated
#
# `Simulation` runs the agents in simulated time, decided by a seed: messages are delayed, lost, duplicated and reordered,
# the team is cut in two for a while, and here agent 1 crashes in the middle of a broadcast.

network = Network()
members = [
    Member(program, number, start, faults=2, deadline=network.deadline) for number in range(5)
]
simulation = Simulation(members, network, [Fault(agent=1, message=42)], seed=0)
outcome = simulation.run(lambda member: member.released)
print(
    f"{outcome.copies} messages, {outcome.time:.1f} s of simulated time, crashed: {outcome.crashed}"
)

# %%
# ## One certificate
#
# All survivors have the same sample, bit for bit. The certificate names the agent that was lost, and where it stopped.

survivors = [member.generated for member in members if member.generated is not None]
print(survivors[0].certify(guidance).table())
assert all((each.generation.z == survivors[0].generation.z).all() for each in survivors)

# %%
# ## Between real processes
#
# In each process, `run_agent(program, number, start, transport, faults=2)` does the same over a `UdpTransport` on one
# machine or a `ZenohTransport` between machines (`pip install 'deggflow[runtime]'`).
