"""How the robots of a shared factor divide what it asks for: the weights w_{a,i} of each factor.

Weights are nonnegative and add up to one over a factor's agents, which is all that the finite-horizon
theorem for shared requirements needs. They decide whether every agent can meet its rows.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .active_set import project_origin, resolution

DELTA = 0.02  # half width of the blend in phi_delta (paper, Task 1)


class AbstractSharing(eqx.Module):
    """Weights of every factor's agents, from what each can do about it."""

    @abc.abstractmethod
    def __call__(
        self, reach: Float[Array, "factors agents"], incident: Bool[Array, "factors agents"]
    ) -> Float[Array, "factors agents"]:
        """Args: reach: |d_{a,i}|^2 of the effective directions; incident: which agents belong to each factor."""


def phi(eta: Float[Array, "..."], delta: float = DELTA) -> Float[Array, "..."]:
    """phi_delta: eta below -delta, 0 above delta, twice continuously differentiable, at most min(eta, 0).

    Source: paper, proof of prop:c2_feasibility.
    """
    s = jnp.clip(eta / delta, -1.0, 1.0)
    blend = delta * (s - 1) ** 3 * (s + 3) / 16
    return jnp.where(eta <= -delta, eta, blend)


def effective_directions(
    ell: Float[Array, "factors agents inputs"], delta: float = DELTA
) -> Float[Array, "factors agents inputs"]:
    """d_{a,i}: what is left of a row's direction when what works against the agent's other rows is taken out.

    Moving against d_{a,i} brings row a down and lets none of the others rise. Two rows: the paper's
    directions, with phi_delta. More: the projection of ell_{a,i} onto the directions that no other row of
    the agent opposes, which is the paper's with phi = min(eta, 0) where there are two.

    Source: paper, before eqn:C2_weights; docs/theory.md for more than two.
    """
    if ell.shape[0] < 2:
        return ell
    square = jnp.sum(ell**2, axis=-1)
    live = square > 0
    norm = jnp.sqrt(jnp.where(live, square, 1.0)) * live
    unit = ell / jnp.where(live, norm, 1.0)[..., None]
    if ell.shape[0] == 2:
        against = phi(jnp.clip(jnp.sum(unit[0] * unit[1], axis=-1), -1.0, 1.0), delta)
        # A factor that an agent can't change leaves the other one as it is.
        against = jnp.where(live[0] & live[1], against, 0.0)
        return ell - (norm * against[None])[..., None] * unit[::-1]
    others = jnp.array([[b for b in range(len(ell)) if b != a] for a in range(len(ell))])
    project = jax.vmap(jax.vmap(_unopposed), in_axes=(0, 1))
    return norm[..., None] * project(unit, unit[others].swapaxes(1, 2).swapaxes(0, 1))


def _unopposed(
    direction: Float[Array, " inputs"], others: Float[Array, "others inputs"]
) -> Float[Array, " inputs"]:
    """The point nearest to a direction from which no other row points away: `others @ d >= 0`."""
    shift, _ = project_origin(-others, -(others @ direction), resolution(direction.dtype))
    return direction + shift


def _normalised(
    amount: Float[Array, "factors agents"], incident: Bool[Array, "factors agents"]
) -> Float[Array, "factors agents"]:
    """Amounts as shares of their factor's sum; equal shares where the sum is zero."""
    total = jnp.sum(amount, axis=-1, keepdims=True)
    equal = incident / jnp.maximum(jnp.sum(incident, axis=-1, keepdims=True), 1)
    return jnp.where(total > 0, amount / jnp.where(total > 0, total, 1.0), equal)


class AdaptiveShares(AbstractSharing):
    """In proportion to |d_{a,i}|^2: agents whose rows oppose each other are asked for less.

    Source: paper, eqn:C2_weights.
    """

    def __call__(
        self, reach: Float[Array, "factors agents"], incident: Bool[Array, "factors agents"]
    ) -> Float[Array, "factors agents"]:
        return _normalised(jnp.where(incident, reach, 0.0), incident)


class EqualShares(AbstractSharing):
    """Every incident agent takes the same part, whatever it can do about the factor; for comparison."""

    def __call__(
        self, reach: Float[Array, "factors agents"], incident: Bool[Array, "factors agents"]
    ) -> Float[Array, "factors agents"]:
        return _normalised(jnp.zeros(incident.shape), incident)


class FixedShares(AbstractSharing):
    """Weights given once and for all, per factor and agent; for comparison."""

    weight: Float[Array, "factors agents"]

    def __call__(
        self, reach: Float[Array, "factors agents"], incident: Bool[Array, "factors agents"]
    ) -> Float[Array, "factors agents"]:
        return _normalised(jnp.where(incident, self.weight, 0.0), incident)
