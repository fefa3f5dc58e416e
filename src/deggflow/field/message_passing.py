"""The nominal vector field: a permutation-equivariant message-passing network."""

from collections.abc import Callable
from copy import copy
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from deggflow.shapes import Scalar, States

from .features import TIME_FEATURES, TeamFeatures, time_features

# Messages are summed, not averaged, so the effect of a neighbour does not depend on the team's size.
MESSAGE_SCALE = 0.25

Product = Callable[
    [Float[Array, "*rows inputs"], Float[Array, "outputs inputs"]], Float[Array, "*rows outputs"]
]
"""(x, weight) -> x @ weight.T"""


def product(
    x: Float[Array, "*rows inputs"], weight: Float[Array, "outputs inputs"]
) -> Float[Array, "*rows outputs"]:
    """The product `x @ weight.T`, in the layout of x (`vmap` of a layer would transpose it)."""
    return x @ weight.T


def bfloat16_product(
    x: Float[Array, "*rows inputs"], weight: Float[Array, "outputs inputs"]
) -> Float[Array, "*rows outputs"]:
    """The product with both factors rounded to bfloat16, accumulated in float32."""
    rounded = x.astype(jnp.bfloat16), weight.astype(jnp.bfloat16)
    over = ((x.ndim - 1,), (1,)), ((), ())
    return jax.lax.dot_general(*rounded, over, preferred_element_type=jnp.float32)


def apply(
    layer: eqx.nn.Linear, x: Float[Array, "*rows inputs"], times: Product = product
) -> Float[Array, "*rows outputs"]:
    """Applies a linear layer to every row."""
    out = times(x, layer.weight)
    return out if layer.bias is None else out + jnp.expand_dims(layer.bias, range(x.ndim - 1))


def _bias(layer: eqx.nn.Linear) -> Float[Array, "1 outputs"]:
    assert layer.bias is not None
    return layer.bias[None]


def apply_mlp(
    mlp: eqx.nn.MLP, x: Float[Array, "*rows inputs"], times: Product = product
) -> Float[Array, "*rows outputs"]:
    """Applies a multilayer perceptron to every row, with the last layer always in float32."""
    for layer in mlp.layers[:-1]:
        x = mlp.activation(apply(layer, x, times))
    return apply(mlp.layers[-1], x)


class Links(NamedTuple):
    """Which agents exchange messages.

    Attributes:
        senders: Indices of each agent's senders; None for all agents, in order.
        weight: Weight of each message, 0 where there is none.
    """

    senders: Int[Array, "agents others"] | None
    weight: Float[Array, "agents others"]

    def spread(self, value: Float[Array, "agents width"]) -> Float[Array, "_ others width"]:
        """The values of each receiver's senders."""
        return value[None, :] if self.senders is None else value[self.senders]


class MessageRound(eqx.Module):
    """One exchange of messages, followed by a residual update of every agent.

    A layer over concatenated inputs is split into one layer per input, and messages are summed before the next linear
    layer. This is the same function at a lower cost.

    Attributes:
        receiver: Layer of the receiver's hidden state.
        sender: Layer of the sender's hidden state.
        pair: Layer of the pair's features.
        inner: First layer of the update, of an agent's hidden state and its summed messages.
        outer: Second layer of the update.
    """

    receiver: eqx.nn.Linear
    sender: eqx.nn.Linear
    pair: eqx.nn.Linear
    inner: eqx.nn.Linear
    outer: eqx.nn.Linear

    def __init__(self, width: int, pair_size: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 5)
        self.receiver = eqx.nn.Linear(width, width, key=keys[0])
        self.sender = eqx.nn.Linear(width, width, use_bias=False, key=keys[1])
        self.pair = eqx.nn.Linear(pair_size, width, use_bias=False, key=keys[2])
        self.inner = eqx.nn.Linear(2 * width, width, key=keys[3])
        self.outer = eqx.nn.Linear(width, width, key=keys[4])

    def __call__(
        self,
        hidden: Float[Array, "agents width"],
        pair: Float[Array, "agents others pair"],
        links: Links,
        times: Product = product,
    ) -> Float[Array, "agents width"]:
        of_pair = apply(self.pair, pair)
        receiver = apply(self.receiver, hidden, times)
        sender = links.spread(apply(self.sender, hidden, times))
        total = jnp.zeros_like(hidden)
        # One sender at a time, as all messages together would not fit into the cache.
        for k in range(pair.shape[1]):
            message = jax.nn.silu(receiver + sender[:, k] + of_pair[:, k])
            total = total + links.weight[:, k, None] * message
        own, received = jnp.split(self.inner.weight, 2, axis=1)
        joint = times(hidden, own) + times(MESSAGE_SCALE * total, received) + _bias(self.inner)
        return hidden + apply(self.outer, jax.nn.silu(joint), times)


class MessagePassingField(eqx.Module):
    """f_theta(tau, z | chi): the same parameters for every agent, equivariant under permutations.

    The output is preconditioned: for Gaussian data of standard deviation `spread`, the optimal field is linear in z. The
    network learns the residual, which has unit scale at every tau.

    Attributes:
        featurise: Features of the team, from (z, condition).
        spread: Standard deviation of the data, per entry of z.
        embed: Layer from an agent's inputs to its hidden state.
        rounds: Exchanges of messages.
        head: Network from an agent's hidden state to its velocity.
        times: Product of hidden states and weights.

    Source: paper, eqn:GNN; preconditioning after Karras et al. (2022), carried over to the straight path.
    """

    featurise: Callable[[States, Any], TeamFeatures] = eqx.field(static=True)
    spread: tuple[float, ...] = eqx.field(static=True)
    embed: eqx.nn.Linear
    rounds: tuple[MessageRound, ...]
    head: eqx.nn.MLP
    times: Product = eqx.field(static=True)

    def __init__(
        self,
        featurise: Callable[[States, Any], TeamFeatures],
        *,
        node_size: int,
        pair_size: int,
        spread: tuple[float, ...],
        width: int = 128,
        rounds: int = 2,
        head_width: int = 256,
        key: PRNGKeyArray,
    ) -> None:
        """Initialises the weights.

        Args:
            featurise: Features of the team, from (z, condition).
            node_size: Number of features of an agent.
            pair_size: Number of features of a pair.
            spread: Standard deviation of the data, per entry of z.
            width: Size of hidden states and messages.
            rounds: Number of message exchanges.
            head_width: Size of the head's hidden layers.
            key: Random key of the weights.
        """
        first, last, *middle = jax.random.split(key, 2 + rounds)
        self.featurise, self.spread, self.times = featurise, spread, product
        self.embed = eqx.nn.Linear(node_size + len(spread) + TIME_FEATURES, width, key=first)
        self.rounds = tuple(MessageRound(width, pair_size, key=k) for k in middle)
        self.head = eqx.nn.MLP(
            width, len(spread), head_width, depth=2, activation=jax.nn.silu, key=last
        )

    def reading(self, featurise: Callable[[States, Any], TeamFeatures]) -> "MessagePassingField":
        """The same weights with other features of the same sizes."""
        return self._with("featurise", featurise)

    def in_bfloat16(self) -> "MessagePassingField":
        """The same weights, with products of hidden states in bfloat16, for machines where this is faster.

        The layers of z and of features, and the last layer, stay in float32. Weights are stored in float32.
        """
        return self._with("times", bfloat16_product)

    def _with(self, name: str, value: Any) -> "MessagePassingField":
        other = copy(self)
        object.__setattr__(other, name, value)
        return other

    def __call__(self, tau: Scalar, z: States, condition: Any) -> States:
        spread = jnp.asarray(self.spread)[None]
        variance = (tau * spread) ** 2 + (1 - tau) ** 2  # of x(tau)
        features = self.featurise(z, condition)
        agents = z.shape[0]
        time = jnp.broadcast_to(time_features(tau), (agents, TIME_FEATURES))
        node = jnp.concatenate([z * jax.lax.rsqrt(variance), features.node, time], axis=-1)
        links = _links(features)
        hidden = jax.nn.silu(apply(self.embed, node))
        for message_round in self.rounds:
            hidden = message_round(hidden, features.pair, links, self.times)
        linear = (tau * spread**2 - (1 - tau)) / variance * z
        return linear + spread * jax.lax.rsqrt(variance) * apply_mlp(self.head, hidden, self.times)


def _links(features: TeamFeatures) -> Links:
    if features.weight is not None:
        return Links(features.senders, features.weight)
    agents = features.mask.shape[0]
    linked = features.mask[None, :] & ~jnp.eye(agents, dtype=bool)
    return Links(None, linked.astype(features.pair.dtype))
