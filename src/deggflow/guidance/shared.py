"""Shared requirements (SE guidance): factors of several agents, each led below a bound of its own."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .bound import AbstractBound, TighteningBound
from .requirement import AbstractRequirement, Demand, input_gradient
from .sharing import AbstractSharing, AdaptiveShares

FactorValue = Callable[[Float[Array, ""], Float[Array, "agents dim"], Any], Float[Array, ""]]
"""q_a(tau, z, condition), at most 0 where the requirement is met; it may depend on tau explicitly."""


def linear(value: Float[Array, ""]) -> Float[Array, ""]:
    """alpha(s) = s (paper, Task 1)."""
    return value


class Recovering(eqx.Module):
    """alpha(s) = s below zero and gain s above: a discrete step that lands above the bound is made good.

    An extended class-K function like any other; where q stays below its bound it changes nothing.
    """

    gain: float = 20.0

    def __check_init__(self) -> None:
        if not self.gain > 0:
            raise ValueError(
                f"`gain` must be positive, else alpha is not of extended class K; got {self.gain}."
            )

    def __call__(self, value: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.where(value > 0, self.gain * value, value)


def everybody(condition: Any) -> None:
    """Incidence of a factor that all agents share."""


class SharedFactor(eqx.Module):
    """One factor a of the factor graph: q_a <= beta_a along the whole generation.

    Args:
        value: q_a(tau, z, condition), continuously differentiable; depends on its own agents' states only.
        bound: beta_a.
        alpha: Extended class-K function; how fast q_a may approach its bound.
        incidence: From the condition, which agents belong to the factor; None for all of them.
        name: What reports call it.

    Source: paper, thm:SE_finite_horizon.
    """

    value: FactorValue
    bound: AbstractBound = TighteningBound()
    alpha: Callable[[Float[Array, ""]], Float[Array, ""]] = linear
    incidence: Callable[[Any], Bool[Array, " agents"] | None] = everybody
    name: str = eqx.field(static=True, default="shared")


class SharedRequirements(AbstractRequirement):
    """The factors that the agents of a team have in common; each gives each of its agents one row.

    With V_a = q_a - beta_a, an agent's row is
    grad_i q_a . (f_i + g_i u_i) + w_{a,i} (dq_a/dtau - dbeta_a/dtau + alpha(V_a)) <= 0.
    Where all agents meet their rows, q_a <= beta_a for all tau (paper, thm:SE_finite_horizon).

    Args:
        factors: Any number.
        sharing: The weights w_{a,i}.
    """

    factors: tuple[SharedFactor, ...]
    sharing: AbstractSharing = AdaptiveShares()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(factor.name for factor in self.factors)

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> tuple[Any, ...]:
        """The bounds, from q_a(0, z(0))."""
        start = jnp.zeros(())
        return tuple(
            factor.bound.init(factor.value(start, z0, condition), condition)
            for factor in self.factors
        )

    def values(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, " factors"]:
        return jnp.stack([factor.value(tau, z, condition) for factor in self.factors])

    def demand(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        control: Float[Array, "agents dim inputs"] | None,
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> Demand:
        q, pull_back = jax.vjp(lambda tau, z: self.values(tau, z, condition), tau, z)
        dq_dtau, gradient = jax.vmap(pull_back)(jnp.eye(len(self.factors), dtype=q.dtype))
        incident = self._incident(z.shape[0], condition)
        gradient = jnp.where(incident[..., None], gradient, 0.0)
        bound, owed = self._owed(state, tau, q, dq_dtau)
        ell = jax.vmap(lambda each: input_gradient(control, each, moving))(gradient)
        rate = jnp.sum(gradient * drift[None], axis=-1)
        return Demand(ell, rate, q, bound, bound, owed)

    def shares(
        self,
        demand: Demand,
        reach: Float[Array, "rows agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> Float[Array, "rows agents"]:
        incident = self._incident(z.shape[0], condition)
        acting = incident if moving is None else incident & moving[None]
        # Where all of a factor's agents have stopped, what it asks stays with them: rows that say so.
        acting = jnp.where(jnp.any(acting, axis=1, keepdims=True), acting, incident)
        return self.sharing(reach, acting) * demand.owed[:, None]  # eqn:SE_finite_horizon_zeta

    def landed(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> tuple[Any, ...]:
        return state  # the bounds stay; alpha leads back below them

    def _incident(self, agents: int, condition: Any) -> Bool[Array, "factors agents"]:
        given = [factor.incidence(condition) for factor in self.factors]
        return jnp.stack([jnp.ones(agents, bool) if one is None else one for one in given])

    def _owed(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        q: Float[Array, " factors"],
        dq_dtau: Float[Array, " factors"],
    ) -> tuple[Float[Array, " factors"], Float[Array, " factors"]]:
        """beta_a, and dq_a/dtau - dbeta_a/dtau + alpha(q_a - beta_a) of every factor."""
        one = jnp.ones_like(tau)
        bounds = [
            jax.jvp(lambda t, f=factor, s=own: f.bound(s, t), (tau,), (one,))
            for factor, own in zip(self.factors, state, strict=True)
        ]
        beta = jnp.stack([bound for bound, _ in bounds])
        dbeta = jnp.stack([slope for _, slope in bounds])
        alpha = jnp.stack(
            [factor.alpha(v) for factor, v in zip(self.factors, q - beta, strict=True)]
        )
        return beta, dq_dtau - dbeta + alpha
