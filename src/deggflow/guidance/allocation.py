"""How the decrease a team owes is shared out among its agents.

Every allocation satisfies `sum_i share_i = sum_j demand_j`, which is all that the finite-horizon theorem
for private requirements needs. They differ in which agents must act and in what an agent must know.
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class AbstractAllocation(eqx.Module):
    """Shares of the agents from the demands of the requirements' owners."""

    @abc.abstractmethod
    def __call__(
        self,
        demand: Float[Array, " owners"],
        influence: Float[Array, " agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, " agents"]:
        """Args: demand: decrease that each owner's violation calls for; influence: |ell_i|^2 of each agent."""


class Own(AbstractAllocation):
    """Each agent brings down its own violation by itself (paper, eqn:PE_rhs)."""

    def __call__(
        self,
        demand: Float[Array, " owners"],
        influence: Float[Array, " agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, " agents"]:
        return demand


class Pooled(AbstractAllocation):
    """The team's whole demand in proportion to what each agent can do about it, |ell_i|^2.

    An agent with `ell_i = 0` owes nothing, so all rows are feasible wherever grad V is not zero altogether.
    """

    def __call__(
        self,
        demand: Float[Array, " owners"],
        influence: Float[Array, " agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, " agents"]:
        total = jnp.sum(influence)
        weight = jnp.where(total > 0, influence / jnp.where(total > 0, total, 1.0), 0.0)
        # Where nobody has any influence the demand stays with its owners: an infeasible row, not silence.
        return jnp.where(total > 0, weight * jnp.sum(demand), demand)


class Local(AbstractAllocation):
    """Each owner's demand among the agents its violation depends on now, in proportion to |ell_i|^2.

    `dependence(z, condition)` tells, for every owner, which agents those are; neighbours' states suffice.
    """

    dependence: Callable[[Float[Array, "agents dim"], Any], Bool[Array, "owners agents"]]

    def __call__(
        self,
        demand: Float[Array, " owners"],
        influence: Float[Array, " agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, " agents"]:
        reach = self.dependence(z, condition) * influence[None]
        total = jnp.sum(reach, axis=1)
        alone = total <= 0  # nobody can act on this owner's violation: its demand stays with it
        shared = jnp.where(alone, 0.0, demand / jnp.where(alone, 1.0, total)) @ reach
        return shared + jnp.where(alone, demand, 0.0)


class LocalPairs(AbstractAllocation):
    """`Local` with the dependence as a list, for teams so large that owners by agents would not do.

    `pairs(z, condition)` lists an owner and an agent its violation depends on, and whether it does now; who stands
    there several times, for several requirements, is asked for as many shares.
    """

    pairs: Callable[
        [Float[Array, "agents dim"], Any],
        tuple[Int[Array, " pairs"], Int[Array, " pairs"], Bool[Array, " pairs"]],
    ]

    def __call__(
        self,
        demand: Float[Array, " owners"],
        influence: Float[Array, " agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, " agents"]:
        owner, agent, now = self.pairs(z, condition)
        reach = jnp.where(now, influence[agent], 0.0)
        total = jnp.zeros_like(demand).at[owner].add(reach)
        alone = total <= 0  # nobody can act on this owner's violation: its demand stays with it
        each = jnp.where(alone, 0.0, demand / jnp.where(alone, 1.0, total))
        shared = jnp.zeros_like(influence).at[agent].add(each[owner] * reach)
        return shared + jnp.where(alone, demand, 0.0)
