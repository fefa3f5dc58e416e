"""What ground, pit, plank and robots look like, as solids; lengths in m, z = 0 on the ground."""

import math
from functools import cache

import numpy as np
from jaxtyping import Float, Int

from deggflow.tasks.bridge import world
from deggflow.view.colours import Colour, blend, rgb
from deggflow.view.solids import Solid, box_between, drum, turned

from .moment import PIT_DEPTH, THICKNESS

MARGIN_X, MARGIN_Y = 0.35, 0.6  # m of ground drawn beyond the workspace
LOST = "#c9c9c9"  # of robots that were lost
WOOD, DARK_WOOD = "#c4935a", "#8a6238"

_SHEET, _SIDE = rgb("#eceae4"), rgb("#cdc7ba")
_OUTER = rgb("#e0dcd2")  # ground beyond the workspace
_LINE, _BORDER = rgb("#dedbd3"), rgb("#8f8878")
_PIT_TOP, _PIT_FLOOR = rgb("#b3a896"), rgb("#4a453f")
_WOOD, _DARK_WOOD, _SEAM = rgb(WOOD), rgb(DARK_WOOD), rgb("#a67843")
_DARK, _WHITE = rgb("#2b2f36"), rgb("#f7f6f2")
_LIP, _STRATA = 0.03, 6  # m, thickness of the ground's upper sheet; shades of the pit's walls
_RING_EDGES = 48


@cache
def surroundings() -> tuple[Solid, ...]:
    """Both grounds with grid and border, and the pit between them."""
    left, right = world.X_MIN - MARGIN_X, world.X_MAX + MARGIN_X
    out = []
    for x0, x1 in ((left, world.GAP_LEFT), (world.GAP_RIGHT, right)):
        out += _ground(x0, x1)
    for x0, x1 in ((world.X_MIN, world.GAP_LEFT), (world.GAP_RIGHT, world.X_MAX)):
        out += _markings(x0, x1)
    return (*out, *_pit())


def _ground(x0: float, x1: float) -> list[Solid]:
    half_y = (world.Y_MAX - world.Y_MIN) / 2 + MARGIN_Y
    out = [
        box_between((x0, x1), (-half_y, half_y), (-_LIP, 0.0), _OUTER),
        box_between((x0, x1), (-half_y, half_y), (-PIT_DEPTH - _LIP, -_LIP), _SIDE),
    ]
    inner = max(x0, world.X_MIN), min(x1, world.X_MAX)
    return [*out, box_between(inner, (world.Y_MIN, world.Y_MAX), (0.0, 0.0005), _SHEET)]


def _markings(x0: float, x1: float) -> list[Solid]:
    """Grid lines a metre apart, and the workspace's border, which ends at the gap."""
    fine, wide = 0.011, 0.018  # half widths
    out = [
        box_between((x - fine, x + fine), (world.Y_MIN, world.Y_MAX), (0.0, 0.001), _LINE)
        for x in range(math.ceil(x0), math.floor(x1) + 1)
        if x0 < x < x1
    ]
    out += [
        box_between((x0, x1), (y - fine, y + fine), (0.0, 0.001), _LINE)
        for y in range(math.ceil(world.Y_MIN) + 1, math.floor(world.Y_MAX))
    ]
    for y in (world.Y_MIN, world.Y_MAX):
        out.append(box_between((x0, x1), (y - wide, y + wide), (0.0, 0.0015), _BORDER))
    for x in {x0, x1} & {world.X_MIN, world.X_MAX}:
        out.append(
            box_between((x - wide, x + wide), (world.Y_MIN, world.Y_MAX), (0.0, 0.0015), _BORDER)
        )
    return out


def _pit() -> list[Solid]:
    """A dark floor, and walls that darken downwards; open towards the viewer."""
    half_y, sheet = (world.Y_MAX - world.Y_MIN) / 2 + MARGIN_Y, 0.004
    floor = box_between(
        (world.GAP_LEFT, world.GAP_RIGHT),
        (-half_y, half_y),
        (-PIT_DEPTH - _LIP, -PIT_DEPTH),
        _PIT_FLOOR,
    )
    out = [floor]
    for k in range(_STRATA):
        heights = (-PIT_DEPTH * (k + 1) / _STRATA, -PIT_DEPTH * k / _STRATA - _LIP * (k == 0))
        colour = blend(_PIT_TOP, _PIT_FLOOR, (k + 0.5) / _STRATA)
        for x in (world.GAP_LEFT, world.GAP_RIGHT - sheet):
            out.append(box_between((x, x + sheet), (-half_y, half_y), heights, colour))
        out.append(
            box_between(
                (world.GAP_LEFT, world.GAP_RIGHT), (half_y - sheet, half_y), heights, colour
            )
        )
    return out


@cache
def plank() -> tuple[Solid, ...]:
    """Three boards between two caps, about the plank's centre."""
    half_x, half_y, cap = world.PLANK_LENGTH / 2, world.PLANK_WIDTH / 2, 0.07
    out = [box_between((-half_x, half_x), (-half_y, half_y), (0.0, THICKNESS - 0.004), _DARK_WOOD)]
    board, seam = world.PLANK_WIDTH / 3, 0.008
    for k in range(3):
        low = -half_y + k * board
        colour = blend(_WOOD, _DARK_WOOD, (0.0, 0.14, 0.05)[k])
        out.append(
            box_between(
                (-half_x + cap, half_x - cap),
                (low + seam * (k > 0), low + board),
                (THICKNESS - 0.004, THICKNESS),
                colour,
            )
        )
    for x in (-half_x, half_x - cap):
        out.append(
            box_between((x, x + cap), (-half_y, half_y), (THICKNESS - 0.004, THICKNESS), _SEAM)
        )
    return tuple(out)


def plank_outline() -> list[Solid]:
    """A frame around the plank's footprint, for its goal pose."""
    half_x, half_y, wire, top = world.PLANK_LENGTH / 2, world.PLANK_WIDTH / 2, 0.035, 0.002
    out = [
        box_between((-half_x, half_x), (y, y + wire), (0.0, top), _WOOD)
        for y in (-half_y, half_y - wire)
    ]
    out += [
        box_between((x, x + wire), (-half_y + wire, half_y - wire), (0.0, top), _WOOD)
        for x in (-half_x, half_x - wire)
    ]
    return out


@cache
def robot(colour: Colour) -> tuple[Solid, ...]:
    """A round robot: bumper, body in its colour, a light deck with a sensor on it."""
    radius = world.ROBOT_RADIUS
    out = [drum(radius, 0.012, 0.055, _DARK)]
    out += turned([(0.95 * radius, 0.055), (0.95 * radius, 0.16), (0.82 * radius, 0.185)], colour)
    out.append(drum(0.66 * radius, 0.185, 0.189, _WHITE))
    out.append(drum(0.40 * radius, 0.189, 0.235, _DARK))
    out.append(drum(0.27 * radius, 0.235, 0.239, colour))
    return tuple(out)


def ring_mesh(
    inner: float, outer: float, height: float
) -> tuple[Float[np.ndarray, "corners 3"], Int[np.ndarray, "faces 3"]]:
    """Corners and triangles of a flat ring on the ground."""
    angles = np.arange(_RING_EDGES) * math.tau / _RING_EDGES
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    profile = ((outer, 0.0), (outer, height), (inner, height), (inner, 0.0))
    corners = np.concatenate(
        [np.column_stack([radius * around, np.full(_RING_EDGES, z)]) for radius, z in profile]
    )
    here = np.arange(_RING_EDGES)
    following = (here + 1) % _RING_EDGES
    faces = []
    for k in range(4):
        low, high = k * _RING_EDGES, ((k + 1) % 4) * _RING_EDGES
        faces.append(np.column_stack([here + low, following + low, following + high]))
        faces.append(np.column_stack([here + low, following + high, here + high]))
    return corners, np.concatenate(faces)
