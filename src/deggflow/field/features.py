"""What a message-passing field reads: features of generative time, of agents and of pairs of agents."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

TIME_FEATURES = 5


class TeamFeatures(NamedTuple):
    """Features of one sample's team, made by the task from (z, condition).

    Every agent hears of every other one; or, where `senders` and `weight` are given, of those alone.
    """

    node: Float[Array, "agents node"]
    pair: Float[Array, "agents others pair"]  # [receiver, sender]
    mask: Bool[Array, " agents"]
    senders: Int[Array, "agents others"] | None = None
    weight: Float[Array, "agents others"] | None = None  # of each sender's message, 0 for none


def time_features(tau: Float[Array, ""]) -> Float[Array, " 5"]:
    """[tau, sin(pi tau), cos(pi tau), sin(2 pi tau), cos(2 pi tau)] (paper: varphi(tau))."""
    angle = jnp.pi * tau
    return jnp.stack([tau, jnp.sin(angle), jnp.cos(angle), jnp.sin(2 * angle), jnp.cos(2 * angle)])
