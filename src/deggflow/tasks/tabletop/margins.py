"""The geometric requirements h_ik of Task 2 and the violation V_i built from them.

Margins are signed distances in m, `h >= 0` where the requirement holds. This file serves guidance, data
and the field; the verdict on a finished scene is `verdict.py`, which shares nothing with it.

Arrays may have a last axis of samples (`*samples`): a batch's short lists of pairs are computed several times as fast side by
side as one after the other.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.guidance import AbstractMargins
from deggflow.shapes import Scalar

from .codec import decode, place, place_outward
from .condition import Parts, TabletopCondition
from .geometry import RoundedBox, box_distance, point_distance, wall_margins
from .hinges import box_violation, caught_violation, hinge_violation, wall_violation
from .pairs import Pairs, between, pick, total, within

ABSENT = 1e3  # m, margin of a requirement that does not exist (padding, an object with itself)


class Margins(NamedTuple):
    """Every margin of a scene, in m; `ABSENT` where there is none."""

    separation: Float[Array, "separations *samples"]  # of every two primitives, `ScenePairs.bodies`
    unobstructed: Float[Array, "obstructions *samples"]  # of regions, `ScenePairs.regions`
    object_wall: Float[Array, "2 primitives *samples"]  # inside the table along x, along y
    region_wall: Float[Array, "2 regions *samples"]


class ScenePairs(NamedTuple):
    """Which parts the margins of a scene are between."""

    bodies: Pairs  # of primitives
    regions: Pairs  # a region and a primitive

    @classmethod
    def of(cls, condition: TabletopCondition) -> "ScenePairs":
        """The pairs of a padded scene."""
        primitives, regions = len(condition.primitives.x), len(condition.regions.x)
        return cls(within(primitives), between(regions, primitives))


def _between_owners(first: Parts, second: Parts, pairs: Pairs) -> Bool[Array, "pairs *samples"]:
    apart = first.owner[pairs.first] != second.owner[pairs.second]
    return apart & first.valid[pairs.first] & second.valid[pairs.second]


def _picked(index: Int[np.ndarray, " pairs"], boxes: RoundedBox) -> RoundedBox:
    return RoundedBox(*(pick(index, field) for field in boxes))


def _free(regions: RoundedBox, bodies: RoundedBox, pairs: Pairs) -> Float[Array, "pairs *samples"]:
    """Signed distance of regions to bodies, m."""
    region, obstacle = _picked(pairs.first, regions), _picked(pairs.second, bodies)
    return point_distance(region.x, region.y, obstacle) - region.radius


def _walls(
    box: RoundedBox, valid: Bool[Array, "parts *samples"], condition: TabletopCondition
) -> Float[Array, "2 parts *samples"]:
    half = jnp.asarray(condition.half_width)[None], jnp.asarray(condition.half_depth)[None]
    margins = jnp.stack(wall_margins(box, *half))
    return jnp.where(valid[None], margins, ABSENT)


def scene_margins(z: Float[Array, "agents 3 *samples"], condition: TabletopCondition) -> Margins:
    """All margins of one scene at the state z, or of a batch along the last axes."""
    pose, pairs = decode(z, condition), ScenePairs.of(condition)
    bodies, regions = condition.primitives, condition.regions
    placed, required = place(bodies, pose), place(regions, pose)
    separation = box_distance(
        _picked(pairs.bodies.first, placed), _picked(pairs.bodies.second, placed)
    )
    free = _free(required, placed, pairs.regions)
    return Margins(
        jnp.where(_between_owners(bodies, bodies, pairs.bodies), separation, ABSENT),
        jnp.where(_between_owners(regions, bodies, pairs.regions), free, ABSENT),
        _walls(placed, bodies.valid, condition),
        _walls(required, regions.valid, condition),
    )


def least_margin(z: Float[Array, "agents 3"], condition: TabletopCondition) -> Scalar:
    """The smallest margin of a scene, in m."""
    margins = scene_margins(z, condition)
    return jnp.min(jnp.stack([jnp.min(margin) for margin in margins]))


def _to_agents(
    value: Float[Array, "parts *samples"], parts: Parts
) -> Float[Array, "agents *samples"]:
    agents = parts.extra_owner.shape[1]
    extra = jnp.sum(parts.extra_owner * value[agents:, None], axis=0)
    return value[:agents] + extra


# Compiled by itself so that a program that evaluates it at several places traces it once.
@partial(jax.jit, static_argnums=(0, 1))
def _violation_and_gradient(
    margins: "TabletopMargins",
    buffer: float,
    z: Float[Array, "agents 3 *samples"],
    condition: TabletopCondition,
) -> tuple[Float[Array, "agents *samples"], Float[Array, "agents 3 *samples"]]:
    def summed(
        z: Float[Array, "agents 3 *samples"],
    ) -> tuple[Scalar, Float[Array, "agents *samples"]]:
        parts = margins.violation(z, condition, buffer)
        return jnp.sum(parts), parts

    gradient, parts = jax.grad(summed, has_aux=True)(z)
    return parts, gradient


class TabletopMargins(AbstractMargins):
    """The margins of each object, in m: it is apart from others, its regions are free, it and they are on the table.

    A separation belongs to both objects, an affordance region and what obstructs it to the region's owner.

    Source: paper, Task 2.
    """

    def __call__(
        self, z: Float[Array, "agents 3"], condition: TabletopCondition
    ) -> Float[Array, "agents 4"]:
        """The least margin of each kind, as `LABELS`; `ABSENT` where there is none."""
        margins, bodies, regions = (
            scene_margins(z, condition),
            condition.primitives.owner,
            condition.regions.owner,
        )
        (first, second), around = ScenePairs.of(condition)
        none = jnp.full(len(condition.mask), ABSENT, z.dtype)
        apart = none.at[bodies[first]].min(margins.separation)
        return jnp.stack(
            [
                apart.at[bodies[second]].min(margins.separation),
                none.at[regions[around.first]].min(margins.unobstructed),
                none.at[bodies].min(jnp.min(margins.object_wall, axis=0)),
                none.at[regions].min(jnp.min(margins.region_wall, axis=0)),
            ],
            axis=1,
        )

    def violation(
        self,
        z: Float[Array, "agents 3 *samples"],
        condition: TabletopCondition,
        buffer: float,
    ) -> Float[Array, "agents *samples"]:
        """V_i of each agent, in m^2: at least sum_k max(buffer - h_ik, 0)^2 / 2, zero where that is zero, without convex kinks."""
        pose, (apart, around) = decode(z, condition), ScenePairs.of(condition)
        bodies, regions = condition.primitives, condition.regions
        placed, required = place(bodies, pose), place(regions, pose)
        half = jnp.asarray(condition.half_width)[None], jnp.asarray(condition.half_depth)[None]
        between = box_violation(_picked(apart.first, placed), _picked(apart.second, placed), buffer)
        between = jnp.where(_between_owners(bodies, bodies, apart), between, 0.0)
        free = hinge_violation(_free(required, placed, around), buffer)
        free = jnp.where(_between_owners(regions, bodies, around), free, 0.0)
        strips = place_outward(condition.strips, place(condition.strips, pose))
        strip, obstacle = _picked(around.first, strips), _picked(around.second, placed)
        free += caught_violation(strip, obstacle, free, buffer)
        of_primitives = jnp.where(bodies.valid, wall_violation(placed, *half, buffer), 0.0)
        of_regions = jnp.where(regions.valid, wall_violation(required, *half, buffer), 0.0)
        size = len(of_primitives)
        of_primitives += total(apart.first, between, size)
        of_primitives += total(apart.second, between, size)
        of_regions += total(around.first, free, len(of_regions))
        return _to_agents(of_primitives, condition.primitives) + _to_agents(
            of_regions, condition.regions
        )

    def violation_and_gradient(
        self, z: Float[Array, "agents 3"], condition: TabletopCondition, buffer: float
    ) -> tuple[Float[Array, " agents"], Float[Array, "agents 3"]]:
        """V_i of each agent, and the gradient of their sum; a batch (by `vmap`) has its samples along the last axis."""
        one = jax.custom_batching.custom_vmap(partial(_violation_and_gradient, self, buffer))

        @one.def_vmap
        def _(size: int, batched: Any, z: Any, condition: Any) -> Any:
            def last(leaf: Array, has: bool) -> Array:
                if not has:
                    leaf = jnp.broadcast_to(leaf, (size, *jnp.shape(leaf)))
                return jnp.moveaxis(leaf, 0, -1)

            out = _violation_and_gradient(
                self, buffer, *jax.tree.map(last, (z, condition), tuple(batched))
            )
            return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), out), (True, True)

        return one(z, condition)

    def dependence(
        self, z: Float[Array, "agents 3"], condition: TabletopCondition, buffer: float
    ) -> Bool[Array, "owners agents"]:
        """Which agents' states each V_j depends on now: itself, and whoever takes part in an active margin of j."""
        margins = scene_margins(z, condition)
        (first, second), (region, obstacle) = ScenePairs.of(condition)
        identity = jnp.eye(condition.mask.shape[-1])
        owner = jnp.concatenate([identity, condition.primitives.extra_owner])
        of_region = jnp.concatenate([identity, condition.regions.extra_owner])
        beside = (margins.separation < buffer)[:, None] * owner[first]
        active = beside.T @ owner[second]
        blocked = (margins.unobstructed < buffer)[:, None] * of_region[region]
        active = active + active.T + blocked.T @ owner[obstacle]
        return (active > 0.0) | jnp.eye(len(active), dtype=bool)


LABELS = ("apart from others", "regions free", "on the table", "regions on the table")
TABLETOP = TabletopMargins()
