"""Agents stay in regions and keep out of regions, at waypoints and along the straight motion between them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import AgentValues, States

from .grid import Grid
from .layout import POINTS, Layout
from .regions import AbstractObstacle, AbstractRegion, Polygon, as_region
from .smooth import maximum_below
from .term import EPS, AbstractOwnTerm, hinge, root
from .values import Value, check_nonnegative, is_constant, one_or_each, resolve


def _radius_of(radius: Value, agents: int, condition: Any, dtype: Any) -> Float[Array, "..."]:
    """A number, or one for each agent of an array over (regions, agents, waypoints)."""
    value = one_or_each("radius", radius, agents, condition, dtype)
    return value if value.ndim == 0 else value[None, :, None]


def _columns(margins: Float[Array, "regions agents steps"]) -> Float[Array, "agents margins"]:
    return jnp.moveaxis(margins, 1, 0).reshape(margins.shape[1], -1)


class Outside(AbstractOwnTerm):
    """Distances from obstacles less each agent's radius, in m.

    Attributes:
        region: Obstacles.
        radius: Of all agents, or one for each.
    """

    region: Value | AbstractObstacle
    radius: Value = 0.0

    def _read(self, z: States, condition: Any) -> tuple[AbstractObstacle, Any, Any]:
        region = resolve(self.region, condition, z.dtype)
        region = region if isinstance(region, AbstractObstacle) else as_region(region)
        radius = _radius_of(self.radius, len(z), condition, z.dtype)
        return region, self.layout.positions(z, condition), radius

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        region, x, radius = self._read(z, condition)
        return _columns(region.clearance(x, self.layout.swept) - radius)

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        region, x, radius = self._read(z, condition)
        return jnp.sum(region.repulsion(x, buffer + radius, EPS * buffer), axis=(0, 2))

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        steps = self.layout.waypoints - self.layout.swept
        region, step = divmod(column, steps)
        text = f"from region {region}{self.layout.when(step, self.layout.swept)}"
        return MarginLabel(text, self.layout.unit)


class Inside(AbstractOwnTerm):
    """Depths within one of several convex regions less each agent's radius, in m.

    Between waypoints, one region holds both ends and so the motion.

    Attributes:
        region: Regions, of which one must hold the agent.
        radius: Of all agents, or one for each.
    """

    region: Value | AbstractRegion
    radius: Value = 0.0

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        region = as_region(resolve(self.region, condition, z.dtype))
        depth = region.depth(self.layout.positions(z, condition))
        if self.layout.swept:
            depth = jnp.minimum(depth[..., 1:], depth[..., :-1])
        radius = _radius_of(self.radius, len(z), condition, z.dtype)
        return _columns(jnp.max(depth, axis=0, keepdims=True) - radius)

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        region = as_region(resolve(self.region, condition, z.dtype))
        faces = region.faces(self.layout.positions(z, condition))
        reach = buffer + _radius_of(self.radius, len(z), condition, z.dtype)
        if faces.shape[1] == 1:
            return jnp.sum(hinge(reach - faces[:, 0]), axis=(0, 2))
        if self.layout.swept:
            faces = jnp.concatenate([faces[..., 1:], faces[..., :-1]])
        # As for one region, with the root of the sum of all hinges of a region: at most its least depth, and without a
        # kink where two faces meet. A width further inside, as the smooth maximum is below the exact one by that.
        width = EPS * buffer
        short = root(2 * jnp.sum(hinge(reach + width - faces), axis=0))
        best = maximum_below(reach + width - short, width, axis=0)
        return jnp.sum(hinge(reach - best[None]), axis=(0, 2))

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(self.layout.when(column, True).strip(), self.layout.unit)


def outside(
    region: Any,
    *,
    radius: Value = 0.0,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "outside",
) -> PrivateRequirement:
    """Agents keep out of regions; on trajectories, along the straight motion between waypoints, too.

    Args:
        region: `Disc`, `Box`, `Polygon`, `Union` or `Grid`, or a tuple of the first four; the name of an entry of the
            condition that holds it, or a function of the condition.
        radius: Of the agents, in m, as discs or balls: of all, or one for each.
        layout: How states are read.
        buffer: What guidance aims at beyond the radius, in m.
        name: What certificates call it.

    Raises:
        TypeError: `region` is none of these.
        ValueError: `radius` is negative or not finite.

    Example:
        >>> outside(Disc((1.0, 0.0), 0.5)).margins(jnp.zeros((1, 2)), None)
        Array([[0.5]], dtype=float32)
    """
    check_nonnegative("radius", radius, "of the agents")
    if is_constant(region) and not isinstance(region, Grid):
        region = as_region(region)
    return PrivateRequirement(Outside(region, radius, layout=layout), buffer, name=name)


def inside(
    region: Any,
    *,
    radius: Value = 0.0,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "inside",
) -> PrivateRequirement:
    """Agents stay in a region, of several in any one of them; on trajectories, between waypoints, too.

    Args: as of `outside`, without `Grid`: `outside(grid) + inside(grid.extent)` asks for the free part of an image. To
        stay in a polygon that is not convex is to stay in its hull and keep out of its notches.

    Raises:
        TypeError: `region` is none of these.
        ValueError: `radius` is negative or not finite.

    Example:
        >>> inside(Box((0.0, 0.0), (2.0, 1.0))).margins(jnp.zeros((1, 2)), None)
        Array([[0.5]], dtype=float32)
    """
    check_nonnegative("radius", radius, "of the agents")
    if isinstance(region, Polygon) and region.notches is not None:
        hull, notches = region.hull, region.notches
        whole = Inside(hull, radius, layout=layout), Outside(notches, radius, layout=layout)
        one, other = (PrivateRequirement(term, buffer, name=name) for term in whole)
        return replace(one + other, name=name)
    if is_constant(region):
        region = as_region(region)
    return PrivateRequirement(Inside(region, radius, layout=layout), buffer, name=name)
