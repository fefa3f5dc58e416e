"""Simple solids that the pictured objects are made of, and ways to put several together.

Lengths in m, angles in rad; x, y in the object's body frame, z up from the table's surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from deggflow.tasks.tabletop.library import Primitive

Point = tuple[float, float, float]
Colour = tuple[float, float, float]

_EDGES = 48  # of the prism that stands for a body of revolution


@dataclass(frozen=True)
class Solid:
    """One geom; `size` as in MJCF: half extents, semi-axes, or radius and half height."""

    shape: Literal["box", "cylinder", "ellipsoid", "capsule", "frustum"]
    size: tuple[float, ...]  # a capsule: its radius; a frustum: lower and upper radius, half height
    colour: Colour
    at: Point = (0.0, 0.0, 0.0)  # centre; one end of a capsule's axis
    turn: Point = (0.0, 0.0, 0.0)  # yaw, pitch, roll: about z, then the new y, then the new x
    to: Point | None = None  # the other end of a capsule's axis


def rgb(code: str) -> Colour:
    """Colour from its code, "#rrggbb"."""
    red, green, blue = (int(code[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def box(half: Point, at: Point, colour: Colour, turn: Point = (0.0, 0.0, 0.0)) -> Solid:
    """A box given by half extents and centre."""
    return Solid("box", half, colour, at, turn)


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


def slab(
    shape: Primitive, bottom: float, top: float, colour: Colour, grow: float = 0.0
) -> list[Solid]:
    """An upright slab over a footprint of the library.

    Args:
        shape: The footprint.
        bottom: Height of the lower face.
        top: Height of the upper face.
        colour: Colour of all of it.
        grow: How far the outline lies outside the footprint (inside if negative).
    """
    hx, hy = shape.half_x - shape.corner, shape.half_y - shape.corner  # core
    corner = max(shape.corner + grow, 0.001)
    inset = min(shape.corner + grow - corner, 0.0)  # what the corner radius could not give
    hx, hy = hx + inset, hy + inset
    if hx <= 0.0 and hy <= 0.0:
        return [drum(corner, bottom, top, colour, shape.x, shape.y)]
    half_height, middle = (top - bottom) / 2, (top + bottom) / 2
    at = (shape.x, shape.y, middle)
    sides = [
        box((hx + corner, hy, half_height), at, colour),
        box((hx, hy + corner, half_height), at, colour),
    ]
    corners = [
        drum(corner, bottom, top, colour, shape.x + sx * hx, shape.y + sy * hy)
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
