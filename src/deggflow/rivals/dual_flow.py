"""Multipliers that flow along with the sample: a Lagrangian's saddle-point dynamics."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.flow import Field

from .rival import AbstractRival, Constraints, left


class DualFlow(AbstractRival):
    """dz/dtau = f - sum_k lambda_k grad g_k / (1 - tau), dlambda_k/dtau = gain g_k / (1 - tau), lambda >= 0.

    Wanted is g = buffer - h <= 0. With `damping` the Lagrangian is an augmented one: damping [g_k]_+ is added to each
    multiplier, without which such dynamics oscillate. Divided by 1 - tau, both settle in prescribed time. The multipliers
    are further columns of the state: `widen` makes room for them, `wrap` lets the field pass them by, `narrow` takes
    them off. Each agent needs the states and multipliers of its neighbours.

    Args:
        constraints: h.
        columns: Columns per agent that hold the multipliers; agents times columns must hold all constraints.
        gain: Of the multipliers; the method's knob.
        damping: Of the augmented term.
        buffer: What is aimed at above h = 0.

    Source: saddle-point dynamics (Arrow, Hurwicz, Uzawa, 1958) along a flow, as Lagrangian dual flows do.
    """

    constraints: Constraints
    columns: int = eqx.field(static=True)
    gain: float | Float[Array, ""] = 2.0
    damping: float | Float[Array, ""] = 4.0
    buffer: float = eqx.field(static=True, default=0.0)

    def widen(
        self, z0: Float[Array, "*samples agents dim"]
    ) -> Float[Array, "*samples agents more"]:
        """The initial sample with multipliers of zero."""
        return jnp.concatenate([z0, jnp.zeros((*z0.shape[:-1], self.columns), z0.dtype)], axis=-1)

    def narrow(
        self, z: Float[Array, "*samples agents more"]
    ) -> Float[Array, "*samples agents dim"]:
        """The sample without the multipliers."""
        return z[..., : -self.columns]

    def wrap(self, field: Field) -> Field:
        """The field, which leaves the multipliers alone."""

        def wider(
            tau: Float[Array, ""], z: Float[Array, "agents more"], condition: Any
        ) -> Float[Array, "agents more"]:
            return self.widen(field(tau, self.narrow(z), condition))

        return wider

    def correction(
        self,
        tau: Float[Array, ""],
        z: Float[Array, "agents more"],
        drift: Float[Array, "agents more"],
        condition: Any,
    ) -> Float[Array, "agents more"]:
        """Downhill on the Lagrangian for the sample, uphill for the multipliers."""
        margin, pull = jax.vjp(lambda x: self.constraints(x, condition), self.narrow(z))
        violation = self.buffer - margin
        kept = z[:, -self.columns :].reshape(-1)
        multiplier = jnp.maximum(kept[: len(violation)], 0.0)
        (down,) = pull((multiplier + self.damping * jnp.maximum(violation, 0.0)) / left(tau))
        grows = (violation > 0) | (multiplier > 0)
        rate = jnp.where(grows, self.gain / left(tau) * violation, 0.0)
        rates = jnp.zeros_like(kept).at[: len(rate)].set(rate).reshape(-1, self.columns)
        return jnp.concatenate([down, rates], axis=-1)
