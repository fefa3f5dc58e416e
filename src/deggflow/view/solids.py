"""Simple solids that the pictured objects are made of, and ways to put several together.

Lengths in m, angles in rad; x, y in the object's body frame, z up from the ground or a table's surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from .colours import Colour

Point = tuple[float, float, float]

_EDGES = 48  # of the prism that stands for a body of revolution


@dataclass(frozen=True)
class Solid:
    """One geom.

    Attributes:
        shape: Its kind.
        size: As in MJCF: a box's half extents; an ellipsoid's semi-axes; a cylinder's radius and half
            height; a capsule's radius. A frustum's lower and upper radius and half height.
        colour: Red, green and blue in [0, 1].
        at: Its centre; of a capsule, one end of the axis.
        turn: Yaw, pitch and roll: about z, then the new y, then the new x.
        to: Of a capsule, the other end of the axis.
    """

    shape: Literal["box", "cylinder", "ellipsoid", "capsule", "frustum"]
    size: tuple[float, ...]
    colour: Colour
    at: Point = (0.0, 0.0, 0.0)
    turn: Point = (0.0, 0.0, 0.0)
    to: Point | None = None


def box(half: Point, at: Point, colour: Colour, turn: Point = (0.0, 0.0, 0.0)) -> Solid:
    """A box given by half extents and centre."""
    return Solid("box", half, colour, at, turn)


def box_between(
    x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], colour: Colour
) -> Solid:
    """A box given by its ends along each axis."""
    half = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2, (z[1] - z[0]) / 2
    return box(half, ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2), colour)


def drum(
    radius: float, bottom: float, top: float, colour: Colour, x: float = 0.0, y: float = 0.0
) -> Solid:
    """An upright cylinder between two heights."""
    return Solid("cylinder", (radius, (top - bottom) / 2), colour, (x, y, (top + bottom) / 2))


def rod(start: Point, end: Point, radius: float, colour: Colour) -> Solid:
    """A capsule around the line from `start` to `end`."""
    return Solid("capsule", (radius,), colour, start, to=end)


def ball(semi_axes: Point, at: Point, colour: Colour, turn: Point = (0.0, 0.0, 0.0)) -> Solid:
    """An ellipsoid."""
    return Solid("ellipsoid", semi_axes, colour, at, turn)


def rounded_slab(
    half: tuple[float, float],
    corner: float,
    heights: tuple[float, float],
    colour: Colour,
    *,
    centre: tuple[float, float] = (0.0, 0.0),
    grow: float = 0.0,
) -> list[Solid]:
    """An upright slab over a rectangle with round corners.

    Args:
        half: Half extents of the rectangle along x and y.
        corner: Radius of its corners.
        heights: Of the lower and the upper face.
        colour: Colour of all of it.
        centre: Of the rectangle.
        grow: How far the slab's outline lies outside the rectangle (inside if negative).
    """
    hx, hy = half[0] - corner, half[1] - corner  # core
    radius = max(corner + grow, 0.001)
    inset = min(corner + grow - radius, 0.0)  # what the corner radius could not give
    hx, hy = hx + inset, hy + inset
    (x, y), (bottom, top) = centre, heights
    if hx <= 0.0 and hy <= 0.0:
        return [drum(radius, bottom, top, colour, x, y)]
    half_height, middle = (top - bottom) / 2, (top + bottom) / 2
    at = (x, y, middle)
    sides = [
        box((hx + radius, hy, half_height), at, colour),
        box((hx, hy + radius, half_height), at, colour),
    ]
    corners = [
        drum(radius, bottom, top, colour, x + sx * hx, y + sy * hy)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return sides + corners


def turned(
    profile: Sequence[tuple[float, float]], colour: Colour, *, x: float = 0.0, y: float = 0.0
) -> list[Solid]:
    """A body of revolution about the vertical through (x, y), as a stack of cut-off cones.

    Args:
        profile: (radius, height) of points on the outline from bottom to top, joined by lines.
        colour: Colour of all of it.
        x: Where the axis stands.
        y: Where the axis stands.
    """
    return [
        Solid("frustum", (r0, r1, (z1 - z0) / 2), colour, (x, y, (z0 + z1) / 2))
        for (r0, z0), (r1, z1) in pairwise(profile)
    ]


def frustum_corners(solid: Solid) -> Float[np.ndarray, "corners 3"]:
    """Corners of the prism that stands for a frustum, about its centre."""
    lower, upper, half = solid.size
    angles = np.arange(_EDGES) * math.tau / _EDGES
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate(
        [
            np.column_stack([radius * around, np.full(_EDGES, height)])
            for radius, height in ((lower, -half), (upper, half))
        ]
    )


def ring(
    centre: Point,
    radius: float,
    wire: float,
    colour: Colour,
    *,
    plane: Literal["xy", "xz", "yz"] = "xy",
    arc: tuple[float, float] = (0.0, 2 * math.pi),
    pieces: int = 16,
) -> list[Solid]:
    """A ring or arc of wire made from capsules; angles count from the plane's first axis."""
    first, second = ("xyz".index(axis) for axis in plane)
    points = []
    for k in range(pieces + 1):
        angle = arc[0] + (arc[1] - arc[0]) * k / pieces
        point = list(centre)
        point[first] += radius * math.cos(angle)
        point[second] += radius * math.sin(angle)
        points.append((point[0], point[1], point[2]))
    return [rod(a, b, wire, colour) for a, b in pairwise(points)]


def rotation(turn: Point) -> Float[np.ndarray, "3 3"]:
    """Matrix of yaw, pitch and roll, column i the turned axis i."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(turn), np.sin(turn)
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return yaw @ pitch @ roll
