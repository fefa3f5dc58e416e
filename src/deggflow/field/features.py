"""Inputs of a message-passing field: features of generative time, of agents and of pairs of agents."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Scalar

TIME_FEATURES = 5


class TeamFeatures(NamedTuple):
    """Features of one sample's team, computed by the task from (z, condition).

    Every agent receives messages from all other agents, or only from `senders` if these are given.

    Attributes:
        node: Features of each agent.
        pair: Features of each pair, as [receiver, sender].
        mask: True for agents that are present, False for padding.
        senders: Indices of the agents that each agent receives messages from; None for all.
        weight: Weight of each sender's message, 0 for no message.
    """

    node: Float[Array, "agents node"]
    pair: Float[Array, "agents others pair"]
    mask: Bool[Array, " agents"]
    senders: Int[Array, "agents others"] | None = None
    weight: Float[Array, "agents others"] | None = None


def time_features(tau: Scalar) -> Float[Array, " 5"]:
    """[tau, sin(pi tau), cos(pi tau), sin(2 pi tau), cos(2 pi tau)] (paper: varphi(tau))."""
    angle = jnp.pi * tau
    return jnp.stack([tau, jnp.sin(angle), jnp.cos(angle), jnp.sin(2 * angle), jnp.cos(2 * angle)])


def stack_features(features: Sequence[Float[Array, "*rows"]]) -> Float[Array, "*rows features"]:
    """`jnp.stack(features, axis=-1)`, laid out for a product with weights.

    XLA evaluates a stack element by element. Here, each feature is written by a separate vectorised loop, with features
    as the first axis in memory, which the following product contracts.
    """
    out = jnp.zeros((len(features), *features[0].shape), features[0].dtype)
    for k, feature in enumerate(features):
        out = jax.lax.dynamic_update_index_in_dim(out, feature, k, 0)
    return jnp.moveaxis(out, 0, -1)
