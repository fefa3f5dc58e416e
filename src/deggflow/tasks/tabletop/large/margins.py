"""A large scene's requirements: margins between neighbours, and the violation V_i built from them.

Margins and their meaning are those of `tabletop/margins.py`; pairs farther apart than anything can bind are not
looked at. A list that was too short would leave out a requirement, so V is then not a number: never a silent violation.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.guidance import AbstractMargins, Pairs
from deggflow.neighbours import Neighbours, find_neighbours
from deggflow.shapes import Scalar
from deggflow.tasks.tabletop.codec import place_outward
from deggflow.tasks.tabletop.geometry import (
    RoundedBox,
    box_distance,
    point_distance,
    wall_margins,
)
from deggflow.tasks.tabletop.hinges import (
    box_violation,
    caught_violation,
    hinge_violation,
    wall_violation,
)
from deggflow.tasks.tabletop.margins import ABSENT

from .condition import LargeSceneCondition, LargeSceneParts, decode, place


class NeighbourMargins(NamedTuple):
    """Margins of a large scene, in m; `ABSENT` where there is none."""

    separation: Float[Array, "bodies slots"]  # each pair once
    unobstructed: Float[Array, "regions slots"]
    body_wall: Float[Array, "2 bodies"]  # inside the table along x, along y
    region_wall: Float[Array, "2 regions"]
    beside: Neighbours  # of the bodies
    around: Neighbours  # of the regions


def between_neighbours(
    z: Float[Array, "agents 3"], condition: LargeSceneCondition, slots: int
) -> NeighbourMargins:
    """All margins that can bind at the state z, with room for `slots` neighbours of each part."""
    pairs = _pairs_of(z, condition, slots)
    beside, around, bodies, regions = pairs
    separation = box_distance(bodies.expand(1), _of_neighbours(bodies, beside))
    return NeighbourMargins(
        jnp.where(_both(condition.bodies, beside), separation, ABSENT),
        jnp.where(_both(condition.regions, around), _free(pairs), ABSENT),
        _walls(bodies, condition.bodies, condition),
        _walls(regions, condition.regions, condition),
        beside,
        around,
    )


class _Pairs(NamedTuple):
    """Who is near whom, and where everything stands."""

    beside: Neighbours  # of the bodies, each pair once
    around: Neighbours  # of the regions
    bodies: RoundedBox
    regions: RoundedBox


def _pairs_of(z: Float[Array, "agents 3"], condition: LargeSceneCondition, slots: int) -> _Pairs:
    """Who is near enough for a requirement to bind."""
    pose = decode(z, condition)
    bodies, regions = place(condition.bodies, pose), place(condition.regions, pose)
    owners = condition.bodies.owner
    number = jnp.arange(len(owners))
    where = jnp.stack([bodies.x, bodies.y], axis=-1)
    beside = find_neighbours(
        where, where, condition.bodies.valid, condition.body_reach, slots,
        lambda found: (found > number[:, None]) & (owners[found] != owners[:, None]),
    )  # fmt: skip
    around = find_neighbours(
        jnp.stack([regions.x, regions.y], axis=-1), where, condition.bodies.valid,
        condition.region_reach, slots,
        lambda found: owners[found] != condition.regions.owner[:, None],
    )  # fmt: skip
    return _Pairs(beside, around, bodies, regions)


def _free(pairs: _Pairs) -> Float[Array, "regions slots"]:
    """Signed distance of regions to the bodies around them, m."""
    regions, bodies = pairs.regions.expand(1), _of_neighbours(pairs.bodies, pairs.around)
    return point_distance(regions.x, regions.y, bodies) - regions.radius


def _of_neighbours(boxes: RoundedBox, neighbours: Neighbours) -> RoundedBox:
    return jax.tree.map(neighbours.gather, boxes)


def _both(parts: LargeSceneParts, neighbours: Neighbours) -> Bool[Array, "parts slots"]:
    return neighbours.near & parts.valid[:, None]


def _walls(
    boxes: RoundedBox, parts: LargeSceneParts, condition: LargeSceneCondition
) -> Float[Array, "2 parts"]:
    margins = jnp.stack(wall_margins(boxes, condition.half_width, condition.half_depth))
    return jnp.where(parts.valid[None], margins, ABSENT)


class LargeSceneMargins(AbstractMargins):
    """The margins of each object of a large scene, in m, as of a table.

    Not a number where some part has more neighbours than `slots`.
    """

    slots: int = eqx.field(static=True, default=12)

    def __call__(
        self, z: Float[Array, "agents 3"], condition: LargeSceneCondition
    ) -> Float[Array, "agents 4"]:
        """The least margin of each kind; `ABSENT` where there is none near."""
        margins = between_neighbours(z, condition, self.slots)
        bodies, regions = condition.bodies.owner, condition.regions.owner
        none = jnp.full(len(condition.mask), ABSENT, z.dtype)
        apart = none.at[bodies].min(jnp.min(margins.separation, axis=1))
        out = jnp.stack(
            [
                apart.at[bodies[margins.beside.who]].min(margins.separation),
                none.at[regions].min(jnp.min(margins.unobstructed, axis=1)),
                none.at[bodies].min(jnp.min(margins.body_wall, axis=0)),
                none.at[regions].min(jnp.min(margins.region_wall, axis=0)),
            ],
            axis=1,
        )
        return jnp.where(margins.beside.missed | margins.around.missed, jnp.nan, out)

    def violation(
        self, z: Float[Array, "agents 3"], condition: LargeSceneCondition, buffer: float
    ) -> Float[Array, " agents"]:
        """V_i of every object, in m^2, as on a table."""
        pairs = _pairs_of(z, condition, self.slots)
        beside, around, bodies, regions = pairs
        agents = len(condition.mask)
        between = box_violation(bodies.expand(1), _of_neighbours(bodies, beside), buffer)
        between = jnp.where(_both(condition.bodies, beside), between, 0.0)
        free = hinge_violation(_free(pairs), buffer)
        free = jnp.where(_both(condition.regions, around), free, 0.0)
        strips = place_outward(condition.strips, place(condition.strips, decode(z, condition)))
        free += caught_violation(strips.expand(1), _of_neighbours(bodies, around), free, buffer)
        half = condition.half_width, condition.half_depth
        at_walls = [
            jnp.where(parts.valid, wall_violation(boxes, *half, buffer), 0.0)
            for boxes, parts in ((bodies, condition.bodies), (regions, condition.regions))
        ]
        other = condition.bodies.owner[beside.who]
        own, free = jnp.sum(between, axis=1) + at_walls[0], jnp.sum(free, axis=1) + at_walls[1]
        total = (
            jnp.zeros(agents, z.dtype)
            .at[condition.bodies.owner].add(own)
            .at[condition.regions.owner].add(free)
            .at[other].add(between)
        )  # fmt: skip
        missed = beside.missed | around.missed
        # A separation counts for both objects (twice in V), though each pair is looked at once.
        return jnp.where(missed, jnp.nan, total)

    def violation_and_gradient(
        self, z: Float[Array, "agents 3"], condition: LargeSceneCondition, buffer: float
    ) -> tuple[Float[Array, " agents"], Float[Array, "agents 3"]]:
        """By reverse mode."""

        def total(z: Float[Array, "agents 3"]) -> tuple[Scalar, Float[Array, " agents"]]:
            parts = self.violation(z, condition, buffer)
            return jnp.sum(parts), parts

        gradient, parts = jax.grad(total, has_aux=True)(z)
        return parts, gradient

    def dependence(
        self, z: Float[Array, "agents 3"], condition: LargeSceneCondition, buffer: float
    ) -> Pairs:
        """Which agents' states each V_j depends on now: whoever takes part in an active margin of j, and j itself."""
        margins = between_neighbours(z, condition, self.slots)
        owners = condition.bodies.owner
        near = owners[margins.beside.who].ravel()
        here = jnp.repeat(owners, self.slots)
        region = jnp.repeat(condition.regions.owner, self.slots)
        self_pairs = jnp.arange(len(condition.mask))
        touching = (margins.separation < buffer).ravel()
        blocked = (margins.unobstructed < buffer).ravel()
        return Pairs(
            jnp.concatenate([self_pairs, here, near, region]),
            jnp.concatenate([self_pairs, near, here, owners[margins.around.who].ravel()]),
            jnp.concatenate([self_pairs >= 0, touching, touching, blocked]),
        )
