"""Regions of the plane or of space that agents stay in or keep out of: discs, boxes, polygons, and unions of them.

One object may hold many regions of a kind. Regions are pytrees of arrays, so that they can be parts of a condition.
Positions have shape (axes, agents, waypoints), and results have a first axis of regions.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import box, convex, exact, polygon
from .term import hinge, length, nearest_on_the_way
from .values import check_finite, check_nonnegative

Positions = Float[Array, "axes agents waypoints"]
Each = Float[Array, "regions agents steps"]


class AbstractObstacle(eqx.Module):
    """Closed sets to keep out of."""

    @abc.abstractmethod
    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        """Hinges that vanish at a distance of at least `reach` from each region, smooth while outside of it.

        Of the motion between waypoints where there are several. Their sum is at least reach^2 / 2 within a region, and
        at least max(reach - d, 0)^2 / 2 at a distance d from one.
        """

    @abc.abstractmethod
    def clearance(self, x: Positions, swept: bool) -> Each:
        """Exact signed distances, of waypoints or of the straight motion between them."""


class AbstractRegion(AbstractObstacle):
    """Convex closed sets, to keep out of or to stay in one of."""

    @abc.abstractmethod
    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        """Signed depths below each face of each region; all nonnegative if and only if a position is inside it."""

    @abc.abstractmethod
    def depth(self, x: Positions) -> Each:
        """Exact signed depths within each region."""


def _rows(value: Any, ndim: int) -> Any:
    """Numbers as an array with a first axis of regions; constants in float64."""
    array = (
        value
        if hasattr(value, "dtype") and not isinstance(value, np.ndarray)
        else np.asarray(value, float)
    )
    return array[None] if array.ndim < ndim else array


def _at_end(value: Float[Array | np.ndarray, "regions axes"]) -> Float[Array, "axes regions 1 1"]:
    return jnp.asarray(value).T[..., None, None]


def _offset(
    x: Positions, centre: Float[Array | np.ndarray, "regions axes"]
) -> Float[Array, "axes regions agents waypoints"]:
    if centre.shape[1] != len(x):
        raise ValueError(
            f"regions must have as many axes as positions, {len(x)}; got {centre.shape[1]}."
        )
    return x[:, None] - _at_end(centre)


class Disc(AbstractRegion):
    """Discs, in space balls.

    Attributes:
        centre: In m, shape (regions, axes); of a single disc also (axes,).
        radius: In m, shape (regions,) or a number.

    Example:
        >>> Disc((1.0, 0.0), 0.6).radius
        array([0.6])
    """

    centre: Float[Array | np.ndarray, "regions axes"]
    radius: Float[Array | np.ndarray, " regions"]

    def __init__(self, centre: Any, radius: Any) -> None:
        check_finite("centre", centre, "a position")
        check_nonnegative("radius", radius, "of each disc")
        self.centre, radius = _rows(centre, 2), _rows(radius, 1)
        self.radius = radius * np.ones(len(self.centre)) if len(radius) == 1 else radius
        if len(self.radius) != len(self.centre):
            raise ValueError(
                f"`radius` must be one number or one for each of {len(self.centre)} discs; got {len(self.radius)}."
            )

    def _from_centre(self, x: Positions) -> Float[Array, "axes regions agents waypoints"]:
        return _offset(x, self.centre)

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        offset = self._from_centre(x)
        if x.shape[2] > 1:
            way = offset[..., 1:] - offset[..., :-1]
            near = nearest_on_the_way(offset[..., :-1], way, eps)
        else:
            near = length(offset)
        return hinge(reach + self.radius[:, None, None] - near)

    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        return (jnp.asarray(self.radius)[:, None, None] - length(self._from_centre(x)))[None]

    def clearance(self, x: Positions, swept: bool) -> Each:
        offset = self._from_centre(x)
        if swept:
            near = exact.segment_from_origin(offset[..., :-1], offset[..., 1:])
        else:
            near = exact.norm(offset)
        return near - jnp.asarray(self.radius)[:, None, None]

    def depth(self, x: Positions) -> Each:
        return -self.clearance(x, swept=False)


class Box(AbstractRegion):
    """Rectangles, in space boxes along the axes.

    Attributes:
        centre: In m, shape (regions, axes); of a single box also (axes,).
        size: Full lengths in m, shape (regions, axes) or (axes,).
        angle: Of rectangles, counter-clockwise in rad; shape (regions,) or a number.

    Example:
        >>> Box((0.0, 0.0), (2.0, 1.0)).size
        array([[2., 1.]])
    """

    centre: Float[Array | np.ndarray, "regions axes"]
    size: Float[Array | np.ndarray, "regions axes"]
    angle: Float[Array | np.ndarray, " regions"]

    def __init__(self, centre: Any, size: Any, angle: Any = 0.0) -> None:
        check_finite("centre", centre, "a position")
        check_nonnegative("size", size, "full lengths")
        check_finite("angle", angle, "in rad")
        self.centre, size, angle = _rows(centre, 2), _rows(size, 2), _rows(angle, 1)
        ones = np.ones(len(self.centre))
        self.size = size * ones[:, None] if len(size) == 1 else size
        self.angle = angle * ones if len(angle) == 1 else angle
        if self.size.shape != self.centre.shape or len(self.angle) != len(self.centre):
            raise ValueError(
                f"`size` and `angle` must be one or one for each of {len(self.centre)} boxes of {self.centre.shape[1]} axes; "
                f"got shapes {self.size.shape} and {self.angle.shape}."
            )
        if self.centre.shape[1] != 2 and isinstance(angle, np.ndarray) and angle.any():
            raise ValueError(
                f"`angle` must be 0 for boxes of {self.centre.shape[1]} axes, which do not turn; got {angle.tolist()}."
            )

    def _local(self, x: Positions) -> Float[Array, "axes regions agents waypoints"]:
        offset = _offset(x, self.centre)
        if len(offset) != 2:
            return offset
        cos, sin = (f(self.angle)[:, None, None] for f in (jnp.cos, jnp.sin))
        return jnp.stack([cos * offset[0] + sin * offset[1], cos * offset[1] - sin * offset[0]])

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        local, half = self._local(x), _at_end(self.size) / 2
        if x.shape[2] > 1:
            return box.segment_repulsion(local[..., :-1], local[..., 1:], half, reach, eps)
        return box.point_repulsion(local, half, reach)

    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        local, half = self._local(x), _at_end(self.size) / 2
        return jnp.concatenate([half - local, half + local])

    def clearance(self, x: Positions, swept: bool) -> Each:
        local, half = self._local(x), _at_end(self.size) / 2
        if swept:
            return exact.segment_from_box(local[..., :-1], local[..., 1:], half)
        return exact.point_from_box(local, half)

    def depth(self, x: Positions) -> Each:
        return -self.clearance(x, swept=False)


class Polygons(AbstractRegion):
    """Convex polygons of the plane with equally many corners.

    Attributes:
        corners: Counter-clockwise, in m.
    """

    corners: Float[Array | np.ndarray, "regions corners 2"]

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        return convex.repulsion(self.corners, x, reach, eps)

    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        return -convex.face_gaps(self.corners, x)

    def clearance(self, x: Positions, swept: bool) -> Each:
        path = jnp.stack([x[..., :-1], x[..., 1:]]) if swept else x[None]
        corners = jnp.moveaxis(jnp.asarray(self.corners), 0, 2)[..., None, None]
        return exact.polygons_apart(corners, path[:, :, None])

    def depth(self, x: Positions) -> Each:
        return -self.clearance(x, swept=False)


class Polygon(AbstractRegion):
    """A simple polygon of the plane, of any number of corners in either direction.

    One that is not convex is cut into triangles. To stay in it is to stay in its hull and out of its notches; where it
    comes from a condition, or in a union, it is to stay in one of its triangles from each waypoint to the next.

    Attributes:
        ring: Its corners, counter-clockwise, in m.
        pieces: Convex pieces.
        hull: The convex hull.
        notches: What the hull has in addition; None if the polygon is convex.

    Example:
        >>> Polygon([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]).pieces.corners.shape
        (1, 3, 2)
    """

    ring: Float[Array | np.ndarray, "corners 2"]
    pieces: Polygons
    hull: Polygons
    notches: "Union | None"

    def __init__(self, corners: Any) -> None:
        ring = polygon.counter_clockwise(np.asarray(corners, float))
        self.ring, self.hull = ring, Polygons(polygon.convex_hull(ring)[None])
        convex = polygon.is_convex(ring)
        self.pieces = self.hull if convex else Polygons(polygon.triangles(ring))
        self.notches = None if convex else Union(tuple(map(Polygon, polygon.notches(ring))))

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        return self.pieces.repulsion(x, reach, eps)

    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        return self.pieces.faces(x)

    def clearance(self, x: Positions, swept: bool) -> Each:
        if self.notches is None:
            return self.pieces.clearance(x, swept)
        # Not of the pieces: what is on the line between two of them is inside.
        ring = jnp.asarray(self.ring)
        if swept:
            return exact.segment_from_ring(x[..., :-1], x[..., 1:], ring)[None]
        return exact.point_from_ring(x, ring)[None]

    def depth(self, x: Positions) -> Each:
        return self.pieces.depth(x)


class Union(AbstractRegion):
    """What belongs to any of several regions.

    Attributes:
        regions: Of any kinds.

    Example:
        >>> len(Union((Disc((0.0, 0.0), 1.0), Box((1.0, 0.0), (2.0, 1.0)))).regions)
        2
    """

    regions: tuple[AbstractRegion, ...]

    def __check_init__(self) -> None:
        if not (isinstance(self.regions, tuple) and self.regions and all(
            isinstance(each, AbstractRegion) for each in self.regions
        )):  # fmt: skip
            raise TypeError(
                f"`regions` must be a tuple of `Disc`, `Box`, `Polygon` or `Union`; got {self.regions!r}."
            )

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        return jnp.concatenate([each.repulsion(x, reach, eps) for each in self.regions])

    def faces(self, x: Positions) -> Float[Array, "faces regions agents waypoints"]:
        each = [region.faces(x) for region in self.regions]
        most = max(len(one) for one in each)
        # The first face again, where a region has fewer than another.
        filled = [
            jnp.concatenate([one, jnp.repeat(one[:1], most - len(one), axis=0)]) for one in each
        ]
        return jnp.concatenate(filled, axis=1)

    def clearance(self, x: Positions, swept: bool) -> Each:
        return jnp.concatenate([each.clearance(x, swept) for each in self.regions])

    def depth(self, x: Positions) -> Each:
        return jnp.concatenate([each.depth(x) for each in self.regions])


def as_region(value: Any) -> AbstractRegion:
    """A region; several are a union.

    Raises:
        TypeError: It is neither.
    """
    many = tuple(value) if isinstance(value, tuple | list) else (value,)
    if not many or not all(isinstance(each, AbstractRegion) for each in many):
        raise TypeError(
            f"`region` must be a `Disc`, `Box`, `Polygon` or `Union`, or a tuple of them; got {value!r}."
        )
    return many[0] if len(many) == 1 else Union(many)
