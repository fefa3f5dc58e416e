"""The tabletop's nominal vector field: the features of a scene that the network reads."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from deggflow.field import MessagePassingField, TeamFeatures, stack_features
from deggflow.files import StrPath
from deggflow.shapes import Scalar
from deggflow.weights import expect_sizes, load_by_card, packaged_weights

from .codec import decode, place
from .condition import Parts, TabletopCondition
from .geometry import RoundedBox, separating_gap, wall_margins
from .library import MAX_OBJECTS

REACH = 0.3  # m, length scale of relative positions
NEAR, FAR = 0.05, 0.2  # m, length scales at which gaps are resolved
SPREAD = (0.53, 0.50, 1.34)  # standard deviation of the training scenes in z
NODE_SIZE = 2 + 8 + MAX_OBJECTS
PAIR_SIZE = 6 + 6
LARGEST = {"width": 8192, "rounds": 64, "head_width": 8192}  # that a card may name
SHIPPED = packaged_weights("deggflow.tasks.tabletop")  # trained weights


def _bodies(parts: Parts, agents: int) -> Parts:
    of_agents = jax.tree.map(lambda leaf: leaf[:agents], parts)
    return of_agents._replace(extra_owner=parts.extra_owner[:0])


def _graded(gap: Float[Array, "..."]) -> list[Float[Array, "..."]]:
    return [jax.nn.soft_sign(gap / NEAR), jax.nn.soft_sign(gap / FAR)]


def relative_pose(receiver: Any, sender: Any) -> list[Any]:
    """Where boxes are from each other, in the frames of both, and how they are turned; of JAX's or PyTorch's arrays."""
    dx, dy = (sender.x - receiver.x) / REACH, (sender.y - receiver.y) / REACH
    return [
        receiver.cos * dx + receiver.sin * dy,
        receiver.cos * dy - receiver.sin * dx,
        sender.cos * dx + sender.sin * dy,
        sender.cos * dy - sender.sin * dx,
        receiver.cos * sender.cos + receiver.sin * sender.sin,
        receiver.cos * sender.sin - receiver.sin * sender.cos,
    ]


def pair_features(
    receiver: RoundedBox,
    sender: RoundedBox,
    receiver_access: RoundedBox,
    sender_access: RoundedBox,
) -> Float[Array, "receivers senders 12"]:
    """Relative poses and gaps of pairs."""
    return stack_features(
        [
            *relative_pose(receiver, sender),
            *_graded(separating_gap(receiver, sender)),
            *_graded(separating_gap(receiver_access, sender)),
            *_graded(separating_gap(sender_access, receiver)),
        ]
    )


def node_features(
    body: RoundedBox,
    access: RoundedBox,
    kind: Int[Array, " agents"],
    half_width: Scalar,
    half_depth: Scalar,
) -> Float[Array, "agents node"]:
    """Headings, distances to the walls, kinds."""
    walls = [wall_margins(box, half_width, half_depth) for box in (body, access)]
    graded = [feature for margins in walls for margin in margins for feature in _graded(margin)]
    kinds = jax.nn.one_hot(kind, MAX_OBJECTS)
    return jnp.concatenate([jnp.stack([body.cos, body.sin, *graded], axis=-1), kinds], axis=-1)


def scene_features(z: Float[Array, "agents 3"], condition: TabletopCondition) -> TeamFeatures:
    """Kinds, headings, distances to the walls; relative poses and gaps of bodies and default affordance regions."""
    pose, agents = decode(z, condition), z.shape[0]
    body = place(_bodies(condition.primitives, agents), pose)
    access = place(condition.access, pose)
    # Computed once: XLA would otherwise fuse sines and cosines into the features of every pair.
    body, access = jax.lax.optimization_barrier((body, access))
    node = node_features(body, access, condition.kind, condition.half_width, condition.half_depth)
    pair = pair_features(body.expand(1), body.expand(0), access.expand(1), access.expand(0))
    return TeamFeatures(node, pair, condition.mask)


def build_field(
    key: PRNGKeyArray, width: int = 128, rounds: int = 2, head_width: int = 256
) -> MessagePassingField:
    """An untrained field of the given size."""
    return MessagePassingField(
        scene_features,
        node_size=NODE_SIZE,
        pair_size=PAIR_SIZE,
        spread=SPREAD,
        width=width,
        rounds=rounds,
        head_width=head_width,
        key=key,
    )


def load_field(path: StrPath | None = None) -> MessagePassingField:
    """A trained field from a safetensors file and its card; the shipped one if no path is given.

    Raises:
        InputError: The card or the weights are not those of a tabletop field.
    """

    def skeleton(card: Mapping[str, Any]) -> MessagePassingField:
        sizes = expect_sizes(card, LARGEST)
        return eqx.filter_eval_shape(build_field, jax.random.key(0), **sizes)

    return load_by_card(SHIPPED if path is None else path, skeleton)
