"""Bodies of the plane that turn keep apart: oriented boxes and convex polygons, at waypoints."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import States

from . import convex, exact, polygon
from .box import overlap
from .layout import Layout
from .term import AbstractPairTerm, hinge
from .values import Value, check_positive, is_constant, resolve

Placed = Float[Array, "corners 2 ..."]


class BodiesApart(AbstractPairTerm):
    """Distances of every two bodies, in m; of overlap, minus the least translation that parts them.

    Attributes:
        corners: Of convex polygons in the frame of a body; of all bodies, or of each.
    """

    corners: Value

    def _placed(self, z: States, condition: Any) -> Float[Array, "corners 2 agents waypoints"]:
        x = self.layout.positions(z, condition)
        cos, sin = self.layout.directions(z, condition)
        body = resolve(self.corners, condition, z.dtype)
        if body.ndim not in (2, 3) or body.shape[-1] != 2 or body.shape[:-2] not in ((), (len(z),)):
            raise ValueError(
                f"`corners` must have shape (corners, 2), or ({len(z)}, corners, 2) with one body for each agent; "
                f"got {body.shape}."
            )
        after = jnp.roll(body, -1, axis=-2)
        area = jnp.sum(body[..., 0] * after[..., 1] - body[..., 1] * after[..., 0], axis=-1)
        body = jnp.where(area[..., None, None] < 0, body[..., ::-1, :], body)
        body = jnp.broadcast_to(body, (len(z), *body.shape[-2:]))
        a, b = body[..., 0].T[..., None], body[..., 1].T[..., None]
        cos, sin = cos[None], sin[None]
        return x[None] + jnp.stack([cos * a - sin * b, sin * a + cos * b], axis=1)

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        body = self._placed(z, condition)
        margins = exact.polygons_apart(body[:, :, :, None], body[:, :, None])
        none = jnp.eye(len(z), dtype=bool)
        if self.mask is not None:
            none |= ~(self.mask[:, None] & self.mask[None])
        return jnp.where(none[..., None], jnp.inf, margins).reshape(len(z), -1)

    def _pairs(
        self, z: States, condition: Any, buffer: float
    ) -> tuple[Float[Array, "pairs waypoints"], Any]:
        """Hinges of every pair, summed over the corners of either on the other, and who its two are."""
        body = self._placed(z, condition)
        first, second = np.triu_indices(len(z), 1)
        one, other = body[:, :, first], body[:, :, second]
        near, gap = _one_way(one, other, buffer)
        near_back, gap_back = _one_way(other, one, buffer)
        values = near + near_back + overlap(jnp.maximum(gap, gap_back), buffer)
        if self.mask is not None:
            values = jnp.where((self.mask[first] & self.mask[second])[:, None], values, 0.0)
        return values, np.eye(len(z))[first] + np.eye(len(z))[second]

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        other, step = divmod(column, self.layout.waypoints)
        return MarginLabel(f"from {agents[other]}{self.layout.when(step, False)}", self.layout.unit)


def _one_way(
    one: Placed, other: Placed, reach: float
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Hinges over the distances of one's corners to the other, and the largest gap beyond the other's faces."""
    normal = convex.normals(other)
    away_x, away_y = (one[None, :, k] - other[:, None, k] for k in range(2))
    gaps = normal[:, None, 0] * away_x + normal[:, None, 1] * away_y
    total = jnp.zeros(one.shape[2:], one.dtype)
    for k in range(len(one)):
        total = total + hinge(reach - convex.point_distance(other, one[k], gaps[:, k]))
    return total, jnp.max(jnp.min(gaps, axis=1), axis=0)


def _convex(corners: Float[np.ndarray, "..."]) -> Float[np.ndarray, "_ 2"]:
    ring = polygon.counter_clockwise(corners)
    if not polygon.is_convex(ring):
        raise ValueError(f"`shape` must be a convex polygon; got {corners.tolist()}.")
    return ring


def bodies_apart(
    shape: Any, *, layout: Layout, buffer: float = 0.01, name: str = "apart"
) -> PrivateRequirement:
    """Bodies that turn with their headings do not overlap, at each waypoint.

    Args:
        shape: (length, width) of rectangles, the length along the heading; or the corners of a convex polygon in the
            frame of the body, shape (corners, 2); or one for each agent, shape (agents, corners, 2). What comes from a
            condition must be convex, too, which is not checked.
        layout: `poses()`, or trajectories with a heading; between waypoints nothing is asked.
        buffer: What guidance aims at between the bodies, in m.
        name: What certificates call it.

    Raises:
        ValueError: A polygon is not convex, or `layout` has no heading.

    Example:
        >>> z = jnp.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
        >>> bodies_apart((1.0, 0.5), layout=poses()).margins(z, None)
        Array([[inf,  1.],
               [ 1., inf]], dtype=float32)
    """
    if layout.heading is None:
        raise ValueError('`layout` must have a heading, "angle" or "vector"; got None.')
    corners = shape
    if is_constant(shape):
        corners = np.asarray(shape, float)
        if corners.shape == (2,):
            check_positive("shape", corners, "(length, width)")
            corners = corners / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        elif corners.ndim == 2:
            corners = _convex(corners)
        elif corners.ndim == 3:
            rings = [_convex(each) for each in corners]
            most = max(map(len, rings))
            # The last corner again, where a body has fewer: an edge of length zero.
            corners = np.array([[*each, *[each[-1]] * (most - len(each))] for each in rings])
    return PrivateRequirement(BodiesApart(corners, layout=layout), buffer, name=name)
