"""How a team's required decrease is shared out among its agents.

Every allocation satisfies `sum_i share_i = sum_j demand_j`, which is all that the finite-horizon theorem
for private requirements needs. They differ in which agents must act and in what an agent must know.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.shapes import AgentValues

from .margins import Dependence, Pairs

OwnerValues = Float[Array, " owners"]
"""One number per owner of a violation."""

LazyDependence = Callable[[], Dependence]
"""Which agents each owner's violation depends on now; called only where that is needed."""


class AbstractAllocation(eqx.Module):
    """Shares of the agents from the demands of the requirements' owners."""

    @abc.abstractmethod
    def __call__(
        self, demand: OwnerValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        """Shares of all agents.

        Args:
            demand: Decrease that each owner's violation calls for.
            effective_norm_sq: |d_i|^2 of each agent, |ell_i|^2 where V's row is its only one.
            dependence: Which agents each owner's violation depends on.
        """


class Own(AbstractAllocation):
    """Each agent brings down its own violation by itself (paper, eqn:PE_rhs)."""

    def __call__(
        self, demand: OwnerValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        return demand


class Pooled(AbstractAllocation):
    """The team's whole demand in proportion to what each agent can do about it, |d_i|^2.

    An agent with `d_i = 0` is asked for nothing, so all rows are feasible wherever some agent can act at all.
    """

    def __call__(
        self, demand: OwnerValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        total = jnp.sum(effective_norm_sq)
        weight = jnp.where(total > 0, effective_norm_sq / jnp.where(total > 0, total, 1.0), 0.0)
        # Where nobody has any influence the demand stays with its owners: an infeasible row, not silence.
        return jnp.where(total > 0, weight * jnp.sum(demand), demand)


class Local(AbstractAllocation):
    """Each owner's demand among the agents its violation depends on now, in proportion to |d_i|^2.

    The gain in an owner's demand still comes from the V of the whole team, so that every agent must know all states. With
    the requirement's `per_owner_gain` an agent's row depends on agents within three links alone (docs/theory.md).
    """

    def __call__(
        self, demand: OwnerValues, effective_norm_sq: AgentValues, dependence: LazyDependence
    ) -> AgentValues:
        influence = dependence()
        if isinstance(influence, Pairs):
            return _among_pairs(demand, effective_norm_sq, influence)
        weight = influence * effective_norm_sq[None]
        total = jnp.sum(weight, axis=1)
        alone = total <= 0  # nobody can act on this owner's violation: its demand stays with it
        # Weights are divided, not demands: what is at most one does not overflow where every weight is tiny.
        shared = jnp.where(alone, 0.0, demand) @ (weight / jnp.where(alone, 1.0, total)[:, None])
        return shared + jnp.where(alone, demand, 0.0)


def _among_pairs(demand: OwnerValues, effective_norm_sq: AgentValues, pairs: Pairs) -> AgentValues:
    """The same from a list, for teams so large that owners by agents would not do.

    Who is listed several times, for several requirements, is asked for as many shares.
    """
    weight = jnp.where(pairs.active, effective_norm_sq[pairs.agent], 0.0)
    total = jnp.zeros_like(demand).at[pairs.owner].add(weight)
    alone = total <= 0
    part = weight / jnp.where(alone, 1.0, total)[pairs.owner]
    each = jnp.where(alone, 0.0, demand)[pairs.owner]
    shared = jnp.zeros_like(effective_norm_sq).at[pairs.agent].add(each * part)
    return shared + jnp.where(alone, demand, 0.0)
