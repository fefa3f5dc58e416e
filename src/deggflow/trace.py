"""What a generation leaves behind: its trace, the work it took, and both in a few numbers."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class Trace(NamedTuple):
    """The generation at every grid point, tau = 1 included."""

    tau: Float[Array, " points"]
    value: Float[Array, "points rows"]  # V or q of each requirement
    bound: Float[Array, "points rows"]  # what the theorem promises of it
    limit: Float[Array, "points rows"]  # what a discrete step may reach
    able: Bool[Array, "points rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, "points agents"]  # this agent had no input that meets its rows
    effort: Float[Array, "points agents"]  # |u_i|
    length: Float[Array, "points rows agents"]  # |ell| where the agent must act, else infinite
    active: Bool[Array, "points rows agents"]  # the row decides the agent's input
    sine: Float[Array, "points agents"]  # least sine between opposed rows that must be met, else 1


class Work(NamedTuple):
    """What the generation took."""

    evaluations: Int[Array, ""]  # of the guided field at the points that steps reached
    refused: Int[Array, ""]  # steps that landed above a limit and were halved
    above: Int[Array, ""]  # steps that were taken although they landed above a limit


class Summary(NamedTuple):
    """A trace and its work in a few numbers; what a certificate says of the generation."""

    value: Float[Array, " rows"]  # at tau = 1
    limit: Float[Array, " rows"]  # at tau = 1
    excess: Float[Array, " rows"]  # greatest value - limit over all points
    active: Int[Array, " rows"]  # points at which the row decided some agent's input
    length: Float[
        Array, " rows"
    ]  # smallest |ell| of an agent that had to act; infinite if none had
    sine: Float[Array, ""]  # least sine between opposed rows of one agent; 1 if there were none
    effort: Float[Array, " agents"]  # largest |u_i|
    stuck: Int[Array, "rows agents"]  # points at which the condition of a feasible row failed
    infeasible: Int[Array, " agents"]  # points at which no input met all rows
    work: Work

    @property
    def held(self) -> Any:
        """Whether rows were feasible, the theorem's conditions held, and no value was above its limit; one for each sample."""
        # Methods of the arrays themselves: thousands of records are made of numpy's, in Python.
        met = (self.excess <= 0).all(axis=-1) & (self.work.above == 0)
        able = (self.stuck == 0).all(axis=(-2, -1))
        return met & able & (self.infeasible == 0).all(axis=-1)


def summarise(trace: Trace, work: Work, present: Bool[Array, " agents"] | None = None) -> Summary:
    """A trace in a few numbers; agents that are not `present` (padding) are left out."""
    here = jnp.ones(trace.effort.shape[1], bool) if present is None else present
    excess = trace.value - trace.limit
    # Bounds start from the value itself, which two programs may round apart.
    start = 4 * jnp.finfo(excess.dtype).eps * jnp.abs(trace.value[0])
    excess = excess.at[0].set(jnp.where(excess[0] <= start, jnp.minimum(excess[0], 0.0), excess[0]))
    acted = jax.tree.map(lambda leaf: leaf[:-1], trace)  # no input follows tau = 1
    return Summary(
        trace.value[-1],
        trace.limit[-1],
        jnp.max(jnp.where(jnp.isnan(excess), jnp.inf, excess), axis=0),
        jnp.sum(jnp.any(acted.active & here[None, None], axis=-1), axis=0),
        jnp.min(jnp.where(here[None, None], acted.length, jnp.inf), axis=(0, 2)),
        jnp.min(jnp.where(here[None], acted.sine, 1.0)),
        jnp.max(jnp.where(here[None], acted.effort, 0.0), axis=0),
        jnp.sum(~acted.able & here[None, None], axis=0),
        jnp.sum(acted.infeasible & here[None], axis=0),
        work,
    )
