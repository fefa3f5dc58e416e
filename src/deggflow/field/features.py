"""What a message-passing field reads: features of generative time, of agents and of pairs of agents."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
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


def stack_features(features: Sequence[Float[Array, "*rows"]]) -> Float[Array, "*rows features"]:
    """`jnp.stack(features, axis=-1)`, made for a product with weights.

    XLA works out a stack number by number; here every feature is written by a loop of its own, over vectors, and the
    product that follows takes the features first.
    """
    out = jnp.zeros((len(features), *features[0].shape), features[0].dtype)
    for k, feature in enumerate(features):
        out = jax.lax.dynamic_update_index_in_dim(out, feature, k, 0)
    return jnp.moveaxis(out, 0, -1)
