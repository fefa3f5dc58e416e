"""What a team does together: formation, centroid, neighbours, a connected graph; and headings."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import AgentValues, Mask, States

from . import exact
from .layout import POINTS, Layout
from .smooth import maximum_below
from .term import EPS, AbstractOwnTerm, AbstractTerm, hinge, length
from .values import Value, check_positive, column, of_team, one_or_each, resolve

Offsets = Float[Array, "axes agents waypoints"]
Distances = Float[Array, "agents agents waypoints"]


def _mean(x: Offsets, mask: Mask) -> Float[Array, "axes 1 waypoints"]:
    """Of the agents that are present."""
    if mask is None:
        return jnp.mean(x, axis=1, keepdims=True)
    weight = mask.astype(x.dtype)[None, :, None]
    return jnp.sum(x * weight, axis=1, keepdims=True) / jnp.sum(weight)


def _present(mask: Mask, agents: int) -> Bool[Array, " agents"]:
    return jnp.ones(agents, bool) if mask is None else mask


class _AbstractTeamTerm(AbstractTerm):
    """A term in which the V_j of an agent that is not zero depends on the states of all agents."""

    def active(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        owner = self.violation(z, condition, buffer) > 0
        return owner[:, None] & _present(self.mask, len(z))[None]


class Formation(_AbstractTeamTerm):
    """A radius less the distance of each agent from its place about the centroid, in m.

    Attributes:
        offsets: Places; only their differences matter.
        within: Radius.
    """

    offsets: Value
    within: Value

    def _offset(self, z: States, condition: Any) -> Offsets:
        x = self.layout.positions(z, condition)
        place = resolve(self.offsets, condition, z.dtype)
        if place.shape != (len(z), len(x)):
            raise ValueError(
                f"`offsets` must have shape ({len(z)}, {len(x)}), one place for each agent; got {place.shape}."
            )
        off = x - place.T[..., None]
        return off - _mean(off, self.mask)

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        within = column("within", self.within, len(z), condition, z.dtype)
        return within - exact.norm(self._offset(z, condition))

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        within = column("within", self.within, len(z), condition, z.dtype)
        return jnp.sum(hinge(buffer - within + length(self._offset(z, condition))), axis=1)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(self.layout.when(column, False).strip(), self.layout.unit)


class Centroid(_AbstractTeamTerm):
    """A radius less the distance of the centroid from a target, in m; every agent owns it.

    Attributes:
        target: One position.
        within: Radius.
    """

    target: Value
    within: Value

    def _offset(self, z: States, condition: Any) -> Float[Array, "axes 1 waypoints"]:
        x = self.layout.positions(z, condition)
        target = resolve(self.target, condition, z.dtype)
        if target.shape != (len(x),):
            raise ValueError(f"`target` must have shape ({len(x)},); got {target.shape}.")
        return _mean(x, self.mask) - target[:, None, None]

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        within = of_team("within", self.within, condition, z.dtype)
        margin = within - exact.norm(self._offset(z, condition))
        return jnp.broadcast_to(margin, (len(z), margin.shape[1]))

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        within = of_team("within", self.within, condition, z.dtype)
        value = jnp.sum(hinge(buffer - within + length(self._offset(z, condition))))
        return jnp.broadcast_to(value, (len(z),))

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(self.layout.when(column, False).strip(), self.layout.unit)


class Neighbour(_AbstractTeamTerm):
    """A radius less the distance to the nearest other agent, in m.

    Attributes:
        within: Radius.
    """

    within: Value

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        x = self.layout.positions(z, condition)
        near = jnp.min(_others(exact.norm(x[:, :, None] - x[:, None]), self.mask), axis=1)
        return column("within", self.within, len(z), condition, z.dtype) - near

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        x = self.layout.positions(z, condition)
        within = one_or_each("within", self.within, len(z), condition, z.dtype)
        within = within if within.ndim == 0 else within[:, None, None]
        room = within - _others(length(x[:, :, None] - x[:, None]), self.mask)
        # An agent that is alone is far from all others, not infinitely far: its V must be finite.
        room = jnp.where(jnp.isfinite(room), room, -1e6)
        return jnp.sum(hinge(buffer - maximum_below(room, EPS * buffer, axis=1)), axis=1)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        where = self.layout.when(column, False)
        return MarginLabel(f"from its nearest neighbour{where}", self.layout.unit)


def _others(distance: Distances, mask: Mask) -> Distances:
    none = jnp.eye(len(distance), dtype=bool)
    if mask is not None:
        none |= ~(mask[:, None] & mask[None])
    return jnp.where(none[..., None], jnp.inf, distance)


class Connected(_AbstractTeamTerm):
    """A radius less the longest link that the team needs to be connected, in m; every agent owns it.

    Guidance shortens every edge of the minimum spanning tree that is too long. The verdict compares, for every two agents,
    the path whose longest link is shortest.

    Attributes:
        within: Radius.
    """

    within: Value

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        x = self.layout.positions(z, condition)
        link = exact.norm(x[:, :, None] - x[:, None])
        present = _present(self.mask, len(z))
        link = jnp.where((present[:, None] & present[None])[..., None], link, jnp.inf)
        for k in range(len(z)):
            link = jnp.minimum(link, jnp.maximum(link[:, k : k + 1], link[k : k + 1]))
        far = jnp.max(jnp.where(present[None, :, None], link, -jnp.inf), axis=1)
        return of_team("within", self.within, condition, z.dtype) - far

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        x = self.layout.positions(z, condition)
        within = of_team("within", self.within, condition, z.dtype)
        tree = jax.lax.stop_gradient(_spanning_tree(x, _present(self.mask, len(z))))
        link = length(x[:, :, None] - x[:, None])
        total = jnp.sum(jnp.where(tree, hinge(buffer - within + link), 0.0))
        return jnp.broadcast_to(total, (len(z),))

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(f"longest link{self.layout.when(column, False)}", self.layout.unit)


def _spanning_tree(
    x: Offsets, present: Bool[Array, " agents"]
) -> Bool[Array, "agents agents waypoints"]:
    """Edges of the minimum spanning tree of each waypoint, each once (Prim's algorithm)."""
    _, agents, waypoints = x.shape
    square = jnp.sum((x[:, :, None] - x[:, None]) ** 2, axis=0)
    index, steps = jnp.arange(agents), jnp.arange(waypoints)
    first = index == jnp.argmax(present)
    inside = jnp.broadcast_to(first[:, None], (agents, waypoints))
    tree = jnp.zeros((agents, agents, waypoints), bool)

    def grow(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
        inside, tree = state
        crossing = inside[:, None] & ~inside[None] & present[None, :, None]
        flat = jnp.where(crossing, square, jnp.inf).reshape(agents * agents, waypoints)
        best = jnp.argmin(flat, axis=0)
        some = jnp.any(crossing, axis=(0, 1))
        old, new = best // agents, best % agents
        tree = tree.at[old, new, steps].max(some)
        return inside.at[new, steps].max(some), tree

    return jax.lax.fori_loop(0, agents - 1, grow, (inside, tree))[1]


class Heading(AbstractOwnTerm):
    """A width less the angle between an agent's heading and a target, in rad.

    Attributes:
        target: Heading, of all agents or of each.
        within: Width, of all agents or of each.
    """

    target: Value
    within: Value

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        cos, sin = self.layout.directions(z, condition)
        target = self._targets(z, condition)
        chord = exact.norm(jnp.stack([cos - jnp.cos(target), sin - jnp.sin(target)]))
        angle = 2 * jnp.arcsin(jnp.minimum(chord / 2, 1.0))
        return column("within", self.within, len(z), condition, z.dtype) - angle

    def _targets(self, z: States, condition: Any) -> Float[Array, "agents 1"]:
        target = one_or_each("target", self.target, len(z), condition, z.dtype)
        return jnp.broadcast_to(target, (len(z),))[:, None]

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        cos, sin = self.layout.directions(z, condition)
        target = self._targets(z, condition)
        c, s = jnp.cos(target), jnp.sin(target)
        angle = jnp.arctan2(sin * c - cos * s, cos * c + sin * s)
        reach = buffer - column("within", self.within, len(z), condition, z.dtype)
        return jnp.sum(hinge(reach + angle) + hinge(reach - angle), axis=1)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(self.layout.when(column, False).strip(), "rad")


def formation(
    offsets: Value,
    within: Value,
    *,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "formation",
) -> PrivateRequirement:
    """Agents keep their places about the team's centroid, at each waypoint.

    Args:
        offsets: Places, shape (agents, axes); only their differences matter.
        within: Largest distance from the own place, in m; of all agents, or one for each.
        layout: How states are read.
        buffer: What guidance aims at below this distance, in m.
        name: What certificates call it.

    Example:
        >>> places = np.array([[0.0, 0.0], [1.0, 0.0]])
        >>> formation(places, 0.5).margins(jnp.array([[3.0, 0.0], [4.5, 0.0]]), None)
        Array([[0.25],
               [0.25]], dtype=float32)
    """
    check_positive("within", within, "the largest distance")
    return PrivateRequirement(Formation(offsets, within, layout=layout), buffer, name=name)


def centroid(
    target: Value,
    within: Value,
    *,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "centroid",
) -> PrivateRequirement:
    """The team's centroid is within a distance of a target, at each waypoint.

    Args:
        target: One position, shape (axes,).
        within: Largest distance, in m.
        layout: How states are read.
        buffer: What guidance aims at below this distance, in m.
        name: What certificates call it.

    Example:
        >>> centroid(np.zeros(2), 0.5).margins(jnp.array([[0.0, 0.0], [0.5, 0.0]]), None)
        Array([[0.25],
               [0.25]], dtype=float32)
    """
    check_positive("within", within, "the largest distance")
    return PrivateRequirement(Centroid(target, within, layout=layout), buffer, name=name)


def neighbour(
    within: Value, *, layout: Layout = POINTS, buffer: float = 0.01, name: str = "neighbour"
) -> PrivateRequirement:
    """Each agent has another one within a distance, at each waypoint.

    Args:
        within: Largest distance to the nearest other agent, in m; of all agents, or one for each.
        layout: How states are read.
        buffer: What guidance aims at below this distance, in m.
        name: What certificates call it.

    Example:
        >>> neighbour(1.0).margins(jnp.array([[0.0, 0.0], [0.5, 0.0]]), None)
        Array([[0.5],
               [0.5]], dtype=float32)
    """
    check_positive("within", within, "the largest distance")
    return PrivateRequirement(Neighbour(within, layout=layout), buffer, name=name)


def connected(
    within: Value, *, layout: Layout = POINTS, buffer: float = 0.01, name: str = "connected"
) -> PrivateRequirement:
    """The graph that links agents within a distance is connected, at each waypoint.

    Args: as of `neighbour`, with one distance for all.

    Example:
        >>> connected(1.0).margins(jnp.array([[0.0, 0.0], [0.5, 0.0], [1.25, 0.0]]), None)
        Array([[0.25],
               [0.25],
               [0.25]], dtype=float32)
    """
    check_positive("within", within, "the largest distance")
    return PrivateRequirement(Connected(within, layout=layout), buffer, name=name)


def heading(
    target: Value,
    within: Value,
    *,
    layout: Layout,
    buffer: float = 0.02,
    name: str = "heading",
) -> PrivateRequirement:
    """Headings are within an angle of a target, either way round, at each waypoint.

    Args:
        target: Heading in rad, of all agents, or of each, shape (agents,).
        within: Largest angle, in rad; of all agents, or one for each.
        layout: `poses()`, or trajectories with a heading.
        buffer: What guidance aims at below this angle, in rad.
        name: What certificates call it.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 2 * jnp.pi - 0.25]])
        >>> round(float(heading(0.0, 0.5, layout=poses()).margins(z, None)[0, 0]), 3)
        0.25
    """
    check_positive("within", within, "the largest angle")
    if layout.heading is None:
        raise ValueError('`layout` must have a heading, "angle" or "vector"; got None.')
    return PrivateRequirement(Heading(target, within, layout=layout), buffer, name=name)
