"""The trained field in a large scene: every object hears of those within a cut-off radius."""

from collections.abc import Callable
from functools import cache, partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.field import MessagePassingField, TeamFeatures
from deggflow.neighbours import find_neighbours
from deggflow.tasks.tabletop.field import node_features, pair_features
from deggflow.tasks.tabletop.geometry import RoundedBox

from .condition import LargeSceneCondition, decode, place

RADIUS = 0.7  # m, beyond which objects do not hear of each other: half the table that the field was trained on
FADE = 0.5  # m, from where on messages fade


def _fading(distance: Float[Array, "..."]) -> Float[Array, "..."]:
    """One up to `FADE`, zero from `RADIUS` on, smooth between: nothing jumps when a neighbour leaves the list."""
    s = jnp.clip((RADIUS - distance) / (RADIUS - FADE), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def large_scene_features(
    z: Float[Array, "agents 3"], condition: LargeSceneCondition, slots: int
) -> TeamFeatures:
    """What `scene_features` tells of a scene, of neighbours alone; not a number where the list is too short."""
    pose = decode(z, condition)
    where = jnp.stack([pose.x, pose.y], axis=-1)
    number = jnp.arange(len(where))
    neighbours = find_neighbours(
        where, where, condition.mask, jnp.asarray(RADIUS), slots,
        lambda neighbours: neighbours != number[:, None],
    )  # fmt: skip
    body, access = place(condition.shape, pose), place(condition.access, pose)
    node = node_features(body, access, condition.kind, condition.half_width, condition.half_depth)

    def of(boxes: RoundedBox) -> RoundedBox:
        return jax.tree.map(neighbours.gather, boxes)

    pair = pair_features(body.expand(1), of(body), access.expand(1), of(access))
    offset = where[neighbours.who] - where[:, None]
    square = jnp.where(neighbours.near, jnp.sum(offset**2, axis=-1), RADIUS**2)
    weight = jnp.where(neighbours.missed, jnp.nan, _fading(jnp.sqrt(square)))
    return TeamFeatures(node, pair, condition.mask, neighbours.who, weight)


@cache  # one object for each: compiled programs are found by what they were compiled for
def _features(
    slots: int,
) -> Callable[[Float[Array, "agents 3"], LargeSceneCondition], TeamFeatures]:
    return partial(large_scene_features, slots=slots)


def large_scene_field(field: MessagePassingField, slots: int) -> MessagePassingField:
    """A tabletop field with the same weights, for large scenes."""
    return field.reading(_features(slots))
