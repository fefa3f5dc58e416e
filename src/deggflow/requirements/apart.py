"""Agents keep apart: points, discs and balls, at waypoints and along the straight motion between them."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import States

from . import exact
from .layout import POINTS, Layout
from .term import EPS, AbstractPairTerm, hinge, length, nearest_on_the_way
from .values import Value, check_positive, one_or_each, resolve

Pairs = Float[Array, "pairs steps"]


class Apart(AbstractPairTerm):
    """Distances of every two agents less the sum of their radii, in m.

    Attributes:
        radius: Of all agents, or one for each.
    """

    radius: Value

    def _radii(self, agents: int, condition: Any, dtype: Any) -> Float[Array, " agents"]:
        radius = one_or_each("radius", self.radius, agents, condition, dtype)
        return jnp.broadcast_to(radius, (agents,))

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        x = self.layout.positions(z, condition)
        offset = x[:, :, None] - x[:, None]
        if self.layout.swept:
            apart = exact.segment_from_origin(offset[..., :-1], offset[..., 1:])
        else:
            apart = exact.norm(offset)
        radii = self._radii(len(z), condition, z.dtype)
        margins = apart - (radii[:, None] + radii[None])[..., None]
        none = jnp.eye(len(z), dtype=bool)
        if self.mask is not None:
            none |= ~(self.mask[:, None] & self.mask[None])
        return jnp.where(none[..., None], jnp.inf, margins).reshape(len(z), -1)

    def _pairs(self, z: States, condition: Any, buffer: float) -> tuple[Pairs, np.ndarray]:
        """Hinges of every pair, and which agents are its two, with signs."""
        x = self.layout.positions(z, condition)
        first, second = np.triu_indices(len(z), 1)
        sign = np.eye(len(z))[first] - np.eye(len(z))[second]
        # A product with a constant matrix: XLA's CPU backend computes gathers and their gradients much more slowly.
        axes, agents, waypoints = x.shape
        flat = jnp.moveaxis(x, 0, 1).reshape(agents, -1)
        offset = (jnp.asarray(sign, x.dtype) @ flat).reshape(-1, axes, waypoints)
        offset = jnp.moveaxis(offset, 1, 0)
        radii = self._radii(agents, condition, z.dtype)
        reach = buffer + (radii[first] + radii[second])[:, None]
        if self.layout.swept:
            way = offset[..., 1:] - offset[..., :-1]
            near = nearest_on_the_way(offset[..., :-1], way, EPS * buffer)
        else:
            near = length(offset)
        values = hinge(reach - near)
        if self.mask is not None:
            values = jnp.where((self.mask[first] & self.mask[second])[:, None], values, 0.0)
        return values, np.abs(sign)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        steps = self.layout.waypoints - self.layout.swept
        other, step = divmod(column, steps)
        text = f"from {agents[other]}{self.layout.when(step, self.layout.swept)}"
        return MarginLabel(text, self.layout.unit)


def apart(
    *,
    distance: Value | None = None,
    radius: Value | None = None,
    layout: Layout = POINTS,
    buffer: float = 0.01,
    name: str = "apart",
) -> PrivateRequirement:
    """Every two agents are at least `distance` apart, or discs (in space, balls) of `radius` do not overlap.

    On trajectories this holds at all times: between waypoints agents move on straight lines at the same time, and the
    least distance has a closed form. Both agents of a pair own its margin, and V depends on those that are too close.

    Args:
        distance: Least distance, in m.
        radius: In place of it: of all agents, or one for each, shape (agents,).
        layout: How states are read.
        buffer: What guidance aims at beyond the distance, in m.
        name: What certificates call it.

    Raises:
        TypeError: Not exactly one of `distance` and `radius` is given.
        ValueError: It is not positive.

    Example:
        >>> apart(distance=0.5).margins(jnp.array([[0.0, 0.0], [0.75, 0.0]]), None)
        Array([[ inf, 0.25],
               [0.25,  inf]], dtype=float32)
    """
    if (distance is None) == (radius is None):
        raise TypeError(
            f"exactly one of `distance` and `radius` must be given; got distance = {distance!r}, radius = {radius!r}."
        )
    check_positive("distance", distance, "the least distance")
    check_positive("radius", radius, "of each agent")
    half: Any = radius if distance is None else _half(distance)
    return PrivateRequirement(Apart(half, layout=layout), buffer, name=name)


def _half(distance: Value) -> Value:
    if isinstance(distance, str) or callable(distance):
        return _Half(distance)
    return distance / 2 if isinstance(distance, jax.Array) else np.asarray(distance, float) / 2


class _Half(eqx.Module):
    """Half of a value from the condition."""

    value: Value

    def __call__(self, condition: Any) -> Any:
        return jnp.asarray(resolve(self.value, condition, None)) / 2
