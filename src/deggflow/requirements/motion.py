"""Limits of a trajectory's motion: speed, acceleration, curvature, length, and where it is from some waypoint on."""

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import AgentValues, States

from . import exact
from .layout import POINTS, Layout
from .term import AbstractOwnTerm, hinge, length
from .values import Value, check_positive, column, resolve

Steps = Float[Array, "agents steps"]


class _AbstractSize(AbstractOwnTerm):
    """A limit less the size of vectors, of which each agent has one for each step."""

    @abc.abstractmethod
    def _vectors(self, z: States, condition: Any) -> Float[Array, "axes agents steps"]:
        """Whose size is limited."""

    @abc.abstractmethod
    def _largest(self, z: States, condition: Any) -> Float[Array, "..."]:
        """The limit, as of `column`."""

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        return self._largest(z, condition) - exact.norm(self._vectors(z, condition))

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        excess = buffer - self._largest(z, condition) + length(self._vectors(z, condition))
        return jnp.sum(hinge(excess), axis=1)


class Rate(_AbstractSize):
    """A limit less the size of differences of positions: of order 1 speeds, of order 2 accelerations.

    Attributes:
        limit: Of all agents, or one for each.
        order: 1 or 2.
    """

    limit: Value
    order: int = eqx.field(static=True)

    def _vectors(self, z: States, condition: Any) -> Float[Array, "axes agents steps"]:
        x = self.layout.positions(z, condition)
        return jnp.diff(x, n=self.order, axis=2) / self.layout.dt**self.order

    def _largest(self, z: States, condition: Any) -> Float[Array, "..."]:
        return column("limit", self.limit, len(z), condition, z.dtype)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        where = self.layout.when(column, True) if self.order == 1 else f" at waypoint {column + 1}"
        time = "/s" if self.order == 1 else "/s^2"
        return MarginLabel(where.strip(), self.layout.unit + time)


class Curvature(AbstractOwnTerm):
    """A limit less the angle turned at a waypoint over the mean length of its two segments, in 1/m.

    Where a segment has no length there is no turn.

    Attributes:
        limit: Of all agents, or one for each, in 1/m.
    """

    limit: Value

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        way = jnp.diff(self.layout.positions(z, condition), axis=2)
        one, other = way[..., :-1], way[..., 1:]
        sizes = exact.norm(one), exact.norm(other)
        moves = (sizes[0] > 0) & (sizes[1] > 0)
        # Kahan's formula of the angle between two vectors, exact for small and for large ones.
        a, b = one * sizes[1][None], other * sizes[0][None]
        turn = 2 * jnp.arctan2(exact.norm(a - b), exact.norm(a + b))
        mean = jnp.where(moves, (sizes[0] + sizes[1]) / 2, 1.0)
        limit = column("limit", self.limit, len(z), condition, z.dtype)
        return limit - jnp.where(moves, turn, 0.0) / mean

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        way = jnp.diff(self.layout.positions(z, condition), axis=2)
        one, other = way[..., :-1], way[..., 1:]
        # The angle does not depend on the lengths, whose squares may underflow.
        (one, size), (other, its_size) = map(_by_size, (one, other))
        mean = (size * length(one) + its_size * length(other)) / 2
        mean = jnp.maximum(mean, _shortest(way.dtype))
        along = jnp.sum(one * other, axis=0)
        if len(way) == 2:
            across = one[0] * other[1] - one[1] * other[0]
        else:
            across = length(jnp.cross(one, other, axis=0))
        still = (along == 0) & (across == 0)
        turn = jnp.arctan2(across, jnp.where(still, 1.0, along))
        curvature = turn / jnp.where(still, 1.0, mean)
        limit = buffer - column("limit", self.limit, len(z), condition, z.dtype)
        # To either side: a choice of the size of the turn would have a kink where the path is straight.
        either = hinge(limit + curvature) + hinge(limit - curvature)
        return jnp.sum(either, axis=1)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(f"at waypoint {column + 1}", f"1/{self.layout.unit}")


def _shortest(dtype: Any) -> float:
    """The cube of a curvature over a shorter segment, which its gradient has, may exceed the largest number of a type."""
    return float(jnp.finfo(dtype).max) ** -0.3


def _by_size(
    vector: Float[Array, "axes ..."],
) -> tuple[Float[Array, "axes ..."], Float[Array, "..."]]:
    """Vectors over their largest entry, and that entry, which is held fixed; what is too short for a gradient has none."""
    size = jax.lax.stop_gradient(jnp.max(jnp.abs(vector), axis=0))
    free = jnp.where(size > _shortest(vector.dtype), vector, jax.lax.stop_gradient(vector))
    return free / jnp.where(size > 0, size, 1.0)[None], size


class Length(AbstractOwnTerm):
    """A limit less the length of the whole path, in m.

    Attributes:
        limit: Of all agents, or one for each, in m.
    """

    limit: Value

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        way = jnp.diff(self.layout.positions(z, condition), axis=2)
        limit = column("limit", self.limit, len(z), condition, z.dtype)
        return limit - jnp.sum(exact.norm(way), axis=1, keepdims=True)

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        way = jnp.diff(self.layout.positions(z, condition), axis=2)
        limit = column("limit", self.limit, len(z), condition, z.dtype)
        return hinge(buffer - limit + jnp.sum(length(way), axis=1, keepdims=True))[:, 0]

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel("", self.layout.unit)


class Near(_AbstractSize):
    """A radius less the distance to a target, from some waypoint on, in m.

    Attributes:
        target: One position for all agents or one for each.
        within: Radius, of all agents or of each.
        since: First waypoint at which it counts.
    """

    target: Value
    within: Value
    since: int = eqx.field(static=True)

    def _vectors(self, z: States, condition: Any) -> Float[Array, "axes agents steps"]:
        x = self.layout.positions(z, condition)[..., self.since :]
        target = resolve(self.target, condition, z.dtype)
        if target.shape not in ((len(x),), (len(z), len(x))):
            raise ValueError(
                f"`target` must have shape ({len(x)},), or ({len(z)}, {len(x)}) with one for each agent; got {target.shape}."
            )
        return x - (target.T[..., None] if target.ndim == 2 else target[:, None, None])

    def _largest(self, z: States, condition: Any) -> Float[Array, "..."]:
        return column("within", self.within, len(z), condition, z.dtype)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(self.layout.when(self.since + column, False).strip(), self.layout.unit)


def _moving(layout: Layout, least: int) -> Layout:
    if layout.waypoints < least:
        raise ValueError(
            f"`layout` must have at least {least} waypoints; got {layout.waypoints}: use `trajectories`."
        )
    return layout


def speed(
    limit: Value, *, layout: Layout, buffer: float = 0.01, name: str = "speed"
) -> PrivateRequirement:
    """Speeds between waypoints are at most `limit`, in m per unit of `layout.dt`.

    Args:
        limit: Of all agents, or one for each.
        layout: Of trajectories.
        buffer: What guidance aims at below the limit, in the same unit.
        name: What certificates call it.

    Example:
        >>> speed(0.75, layout=trajectories(2)).margins(jnp.array([[0.0, 0.0, 0.5, 0.0]]), None)
        Array([[0.25]], dtype=float32)
    """
    check_positive("limit", limit, "a speed")
    return PrivateRequirement(Rate(limit, 1, layout=_moving(layout, 2)), buffer, name=name)


def acceleration(
    limit: Value, *, layout: Layout, buffer: float = 0.01, name: str = "acceleration"
) -> PrivateRequirement:
    """Second differences of positions over `layout.dt` squared are at most `limit`.

    Args: as of `speed`.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 0.5, 0.0, 0.5, 0.0]])
        >>> acceleration(0.75, layout=trajectories(3)).margins(z, None)
        Array([[0.25]], dtype=float32)
    """
    check_positive("limit", limit, "an acceleration")
    return PrivateRequirement(Rate(limit, 2, layout=_moving(layout, 3)), buffer, name=name)


def curvature(
    limit: Value, *, layout: Layout, buffer: float = 0.1, name: str = "curvature"
) -> PrivateRequirement:
    """The angle turned at each waypoint over the mean length of its two segments is at most `limit`, in 1/m.

    Args: as of `speed`; a robot whose least turning radius is r has the limit 1 / r.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 1.0, 0.0, 2.0, 0.0]])
        >>> curvature(0.5, layout=trajectories(3)).margins(z, None)
        Array([[0.5]], dtype=float32)
    """
    check_positive("limit", limit, "a curvature")
    return PrivateRequirement(Curvature(limit, layout=_moving(layout, 3)), buffer, name=name)


def path_length(
    limit: Value, *, layout: Layout, buffer: float = 0.01, name: str = "length"
) -> PrivateRequirement:
    """Each path is at most `limit` long, in m.

    Args: as of `speed`.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 0.5, 0.0]])
        >>> path_length(0.75, layout=trajectories(2)).margins(z, None)
        Array([[0.25]], dtype=float32)
    """
    check_positive("limit", limit, "a length")
    return PrivateRequirement(Length(limit, layout=_moving(layout, 2)), buffer, name=name)


def near(
    target: Value,
    within: Value,
    *,
    since: int = 0,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "near",
) -> PrivateRequirement:
    """Positions are within a distance of a target at all waypoints from `since` on.

    Args:
        target: One position for all agents, shape (axes,), or one for each, shape (agents, axes).
        within: Largest distance, in m; of all agents, or one for each.
        since: First waypoint that counts; negative: from the end.
        layout: How states are read.
        buffer: What guidance aims at below the distance, in m.
        name: What certificates call it.

    Example:
        >>> near(np.zeros(2), 1.0).margins(jnp.array([[0.5, 0.0]]), None)
        Array([[0.5]], dtype=float32)
    """
    check_positive("within", within, "the largest distance")
    first = since + layout.waypoints if since < 0 else since
    if not 0 <= first < layout.waypoints:
        raise ValueError(f"`since` must be one of {layout.waypoints} waypoints; got {since}.")
    return PrivateRequirement(Near(target, within, first, layout=layout), buffer, name=name)


def deadline(
    goal: Value,
    waypoint: int,
    *,
    within: Value,
    layout: Layout,
    buffer: float = 0.01,
    name: str = "deadline",
) -> PrivateRequirement:
    """Every agent is at its goal by a waypoint, within a distance, and stays there.

    Args: as of `near`, whose `target` and `since` these are.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 1.0, 0.0, 1.0, 0.0]])
        >>> deadline(np.array([1.0, 0.0]), 1, within=0.5, layout=trajectories(3)).margins(z, None)
        Array([[0.5, 0.5]], dtype=float32)
    """
    return near(goal, within, since=waypoint, layout=layout, buffer=buffer, name=name)
