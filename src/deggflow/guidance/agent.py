"""One agent's view: its input from its own drift and from what it must be told, and nothing else.

This is what a process per agent runs: the others' states come in once a step, no input and no drift of theirs.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Mask, Scalar, States

from .decoupled import DecoupledGuidance
from .requirement import Rows, correction


class AgentInput(NamedTuple):
    """What one agent does at one step.

    Attributes:
        u: Its input.
        correction: g_i u_i, added to its drift.
        feasible: Whether the input meets all of its rows.
        rows: Those of the whole team. Where they depend on the drift of another agent that moves, they are not numbers.
    """

    u: Float[Array, " inputs"]
    correction: Float[Array, " dim"]
    feasible: Bool[Array, ""]
    rows: Rows


class CommunicationCost(NamedTuple):
    """What an agent must be told, in bytes.

    Attributes:
        states: z_j of every other agent, in each step.
        start: z_j(0) of every other agent, once; bounds and gains begin from there.
    """

    states: int
    start: int

    @property
    def per_step(self) -> int:
        """Bytes in every step."""
        return self.states


def agent_input(
    guidance: DecoupledGuidance,
    state: Any,
    agent: Int[Array, ""],
    tau: Scalar,
    z: States,
    drift: Float[Array, " dim"],
    condition: Any,
    moving: Mask = None,
) -> AgentInput:
    """The input of a single agent, equal to its part of the batched computation.

    Args:
        guidance: The team's guidance; every agent has the same copy.
        state: `guidance.init(z0, condition)`, made once from z(0).
        agent: Which agent.
        tau: Generative time.
        z: Its own state and those it was told.
        drift: Its own nominal drift f_i; nobody else's is needed.
        condition: What field and requirements are conditioned on.
        moving: Who still moves; those who don't have no drift.
    """
    # The others' drifts stay unknown: were one of them used, the input would not be a number.
    drifts = jnp.full_like(z, jnp.nan).at[agent].set(drift)
    if moving is not None:
        drifts = jnp.where(moving[:, None], drifts, 0.0)
    rows = guidance.rows(state, tau, z, drifts, condition, moving)
    ell, b = rows.ell[:, agent], rows.b[:, agent]
    u, feasible = guidance.solve(ell, b, guidance.metric_of(agent))
    if guidance.control is None:
        return AgentInput(u, u, feasible, rows)
    own = guidance.control(tau, z, condition)[agent]
    return AgentInput(u, correction(own[None], u[None])[0], feasible, rows)


def communication_cost(z: States | jax.ShapeDtypeStruct) -> CommunicationCost:
    """Bytes that one agent of a team receives, where requirements depend on all states."""
    others = (z.shape[0] - 1) * z.shape[1] * z.dtype.itemsize
    return CommunicationCost(others, others)
