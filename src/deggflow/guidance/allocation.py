"""How a team divides the decrease that a row of a requirement asks for.

The decrease belongs to the agents from the start: c omega V_j^rho to the agent that owns V_j, equal parts of what a
factor asks for to the factor's agents. An allocation passes these demands on. Every allocation satisfies
`sum_i share_i = sum_j demand_j`, which is all that the finite-horizon theorems need. They differ in which agents must
act and in what an agent must know.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp

from deggflow.shapes import AgentValues

from .margins import Dependence, Pairs

LazyDependence = Callable[[], Dependence]
"""Among which agents each owner's demand may be divided; called only where that is needed."""


class AbstractAllocation(eqx.Module):
    """Shares of the agents in one row, from what each of them owns of the demand."""

    @abc.abstractmethod
    def __call__(
        self, demand: AgentValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        """zeta: shares of all agents.

        Args:
            demand: What each agent owns of the required decrease.
            effective_norm_sq: |d_i|^2 of each agent, |ell_i|^2 where the row is its only one.
            dependence: Among which agents each owner's demand may be divided: those that its violation depends on,
                or all of a factor's agents.
        """


class Own(AbstractAllocation):
    """Each agent keeps its own demand: of a violation the owner's (paper, eqn:PE_rhs), of a factor an equal part."""

    def __call__(
        self, demand: AgentValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        return demand


class Pooled(AbstractAllocation):
    """The team's whole demand in proportion to what each agent can do about it, |d_i|^2 (paper, eqn:C2_weights).

    An agent with `d_i = 0` is asked for nothing, so all rows are feasible wherever some agent can act at all.
    """

    def __call__(
        self, demand: AgentValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        total = jnp.sum(effective_norm_sq)
        weight = jnp.where(total > 0, effective_norm_sq / jnp.where(total > 0, total, 1.0), 0.0)
        # Where nobody has any influence the demand stays with its owners: an infeasible row, not silence.
        return jnp.where(total > 0, weight * jnp.sum(demand), demand)


class Local(AbstractAllocation):
    """Each owner's demand among the agents its violation depends on now, in proportion to |d_i|^2.

    The gain in an owner's demand still comes from the V of the whole team, so that every agent must know all states. With
    the requirement's `per_owner_gain` an agent's row depends on agents within three links alone (docs/theory.md). The
    demand for a factor is divided among all of the factor's agents, as by `Pooled`.
    """

    def __call__(
        self, demand: AgentValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        return _among_dependents(demand, effective_norm_sq, dependence())


class Fixed(AbstractAllocation):
    """Each owner's demand among the same agents in proportion to given weights, whatever they can do about it.

    For comparison: rows are infeasible where an agent with a positive weight can't act.

    Attributes:
        weight: One nonnegative number per agent.

    Example:
        >>> together = jnp.ones((2, 2), bool)
        >>> Fixed(jnp.array([1.0, 3.0]))(jnp.array([4.0, 4.0]), jnp.zeros(2), lambda: together)
        Array([2., 6.], dtype=float32)
    """

    weight: AgentValues

    def __call__(
        self, demand: AgentValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        if self.weight.shape != demand.shape:
            raise ValueError(
                f"`weight` must have shape {demand.shape}, one number per agent; got {self.weight.shape}."
            )
        return _among_dependents(demand, self.weight.astype(demand.dtype), dependence())


def _among_dependents(
    demand: AgentValues, weight: AgentValues, dependence: Dependence
) -> AgentValues:
    """Each owner's demand among the agents that it depends on, in proportion to their weights."""
    if isinstance(dependence, Pairs):
        return _among_pairs(demand, weight, dependence)
    part = dependence * weight[None]
    total = jnp.sum(part, axis=1)
    alone = total <= 0  # nobody can act on this owner's violation: its demand stays with it
    # Weights are divided, not demands: what is at most one does not overflow where every weight is tiny.
    shared = jnp.where(alone, 0.0, demand) @ (part / jnp.where(alone, 1.0, total)[:, None])
    return shared + jnp.where(alone, demand, 0.0)


def _among_pairs(demand: AgentValues, weight: AgentValues, pairs: Pairs) -> AgentValues:
    """The same from a list, for teams so large that owners by agents would not do.

    Who is listed several times, for several requirements, is asked for as many shares.
    """
    part = jnp.where(pairs.active, weight[pairs.agent], 0.0)
    total = jnp.zeros_like(demand).at[pairs.owner].add(part)
    alone = total <= 0
    part = part / jnp.where(alone, 1.0, total)[pairs.owner]
    each = jnp.where(alone, 0.0, demand)[pairs.owner]
    shared = jnp.zeros_like(weight).at[pairs.agent].add(each * part)
    return shared + jnp.where(alone, demand, 0.0)
