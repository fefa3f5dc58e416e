"""The message-passing network in PyTorch, with the weights of a trained `MessagePassingField`."""

import equinox as eqx
import jax
import numpy as np

from .features import TIME_FEATURES
from .message_passing import MESSAGE_SCALE, MessagePassingField
from .torch import torch

silu = torch.nn.functional.silu


class TorchMessageRound(torch.nn.Module):
    """One exchange of messages, followed by a residual update of every agent."""

    def __init__(self, width: int, pair_size: int) -> None:
        super().__init__()
        self.receiver = torch.nn.Linear(width, width)
        self.sender = torch.nn.Linear(width, width, bias=False)
        self.pair = torch.nn.Linear(pair_size, width, bias=False)
        self.inner = torch.nn.Linear(2 * width, width)
        self.outer = torch.nn.Linear(width, width)

    def forward(
        self, hidden: torch.Tensor, pair: torch.Tensor, linked: torch.Tensor
    ) -> torch.Tensor:
        """Updated hidden states, of shape (samples, agents, width).

        Args:
            hidden: (samples, agents, width).
            pair: (samples, receivers, senders, pair).
            linked: (samples, receivers, senders), True where the receiver gets the sender's message.
        """
        message = silu(
            self.receiver(hidden)[:, :, None] + self.sender(hidden)[:, None] + self.pair(pair)
        )
        total = torch.where(linked[..., None], message, 0.0).sum(dim=2)
        joint = torch.cat([hidden, MESSAGE_SCALE * total], dim=-1)
        return hidden + self.outer(silu(self.inner(joint)))


class TorchMessagePassing(torch.nn.Module):
    """The network of a `MessagePassingField`, from features to dz/dtau."""

    spread: torch.Tensor

    def __init__(
        self,
        *,
        node_size: int,
        pair_size: int,
        spread: tuple[float, ...],
        width: int,
        rounds: int,
        head_width: int,
    ) -> None:
        super().__init__()
        self.embed = torch.nn.Linear(node_size + len(spread) + TIME_FEATURES, width)
        self.rounds = torch.nn.ModuleList(
            TorchMessageRound(width, pair_size) for _ in range(rounds)
        )
        sizes = (width, head_width, head_width, len(spread))
        self.head = torch.nn.ModuleList(map(torch.nn.Linear, sizes, sizes[1:]))
        self.register_buffer("spread", torch.tensor(spread), persistent=False)

    def forward(
        self,
        x: torch.Tensor,
        t: torch.Tensor,
        node: torch.Tensor,
        pair: torch.Tensor,
        mask: torch.Tensor,
    ) -> torch.Tensor:
        """dz/dtau of shape (samples, agents, dim).

        Args:
            x: States, of shape (samples, agents, dim).
            t: tau, of shape (samples,).
            node: Features of agents, of shape (samples, agents, node).
            pair: Features of pairs, of shape (samples, receivers, senders, pair).
            mask: False for padding, of shape (samples, agents).
        """
        tau, agents = t[:, None, None], x.shape[1]
        variance = (tau * self.spread) ** 2 + (1 - tau) ** 2
        angle = torch.pi * tau
        time = [tau, angle.sin(), angle.cos(), (2 * angle).sin(), (2 * angle).cos()]
        clock = torch.cat(time, dim=-1).expand(-1, agents, -1)
        self_pair = torch.eye(agents, dtype=torch.bool, device=x.device)
        linked = mask[:, None, :] & ~self_pair
        hidden = silu(self.embed(torch.cat([x * variance.rsqrt(), node, clock], dim=-1)))
        for message_round in self.rounds:
            hidden = message_round(hidden, pair, linked)
        *inner, last = self.head
        for layer in inner:
            hidden = silu(layer(hidden))
        linear = (tau * self.spread**2 - (1 - tau)) / variance * x
        return linear + self.spread * variance.rsqrt() * last(hidden)


def export(field: MessagePassingField) -> TorchMessagePassing:
    """A trained field's network in PyTorch, in evaluation mode, without the features (`featurise`)."""
    width, inputs = field.embed.weight.shape
    network = TorchMessagePassing(
        node_size=inputs - len(field.spread) - TIME_FEATURES,
        pair_size=field.rounds[0].pair.weight.shape[1],
        spread=field.spread,
        width=width,
        rounds=len(field.rounds),
        head_width=field.head.width_size,
    )
    weights = jax.tree_util.tree_leaves_with_path(eqx.filter(field, eqx.is_inexact_array))
    # "rounds[0].pair.weight" is "rounds.0.pair.weight" here, "head.layers[0].bias" is "head.0.bias".
    names = [
        jax.tree_util.keystr(path).replace(".layers", "").replace("[", ".").replace("]", "")[1:]
        for path, _ in weights
    ]
    arrays = [torch.from_numpy(np.array(leaf)) for _, leaf in weights]
    network.load_state_dict(dict(zip(names, arrays, strict=True)))
    return network.eval()
