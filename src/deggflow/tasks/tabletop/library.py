"""The twelve objects of the tabletop task and their affordance regions.

Source: paper, Table "Object geometry and default affordance regions for Task 2". Lengths in m, angles
in rad, coordinates in the object's body frame. Masses are our estimates of objects filled or in use.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

TABLE_WIDTH = 1.40  # m
TABLE_DEPTH = 0.94  # m


@dataclass(frozen=True)
class Primitive:
    """A rounded rectangle with half extents (including the rounding); a disk has both equal to the radius."""

    half_x: float
    half_y: float
    corner: float  # m, corner radius
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Region:
    """A disk beside the object that must be free for the object to be used."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class ObjectType:
    """One kind of object: shape, default affordance regions, and other directions a user may ask for."""

    name: str
    primitives: tuple[Primitive, ...]
    regions: tuple[Region, ...]
    directions: tuple[float, ...]  # rad, alternatives to the default direction 0
    mass: float  # kg, in the object's origin


def _disk(radius: float, x: float = 0.0, y: float = 0.0) -> Primitive:
    return Primitive(radius, radius, radius, x, y)


def _row(xs: tuple[float, ...], y: float, radius: float) -> tuple[Region, ...]:
    return tuple(Region(x, y, radius) for x in xs)


_QUARTER = (-math.pi / 2, math.pi / 2)
_TILT = (-math.pi / 6, math.pi / 6)
_ALL = (math.pi, *_QUARTER)

LIBRARY: tuple[ObjectType, ...] = (
    ObjectType(
        "drawer_organizer",
        (Primitive(0.156, 0.090, 0.012),),
        _row((-0.1, 0.0, 0.1), -0.205, 0.108),
        _TILT,
        1.2,
    ),
    ObjectType(
        "teacup", (_disk(0.046), _disk(0.019, 0.061)), (Region(0.125, 0.0, 0.055),), _ALL, 0.35
    ),
    ObjectType("desk_lamp", (_disk(0.06),), (Region(0.0, -0.147, 0.079),), _QUARTER, 1.6),
    ObjectType("laptop", (Primitive(0.085, 0.065, 0.006),), (Region(0.155, 0.0, 0.07),), _ALL, 1.4),
    ObjectType("potted_plant", (_disk(0.078),), (Region(0.0, -0.123, 0.062),), _ALL, 2.2),
    ObjectType("handled_mug", (_disk(0.067),), (Region(0.0, -0.141, 0.054),), _QUARTER, 0.45),
    ObjectType(
        "drawing_board",
        (Primitive(0.135, 0.048, 0.008),),
        _row((-0.065, 0.065), -0.108, 0.05),
        _TILT,
        0.8,
    ),
    ObjectType(
        "scissors", (Primitive(0.039, 0.026, 0.016),), (Region(0.083, 0.0, 0.043),), _ALL, 0.1
    ),
    ObjectType(
        "compact_printer",
        (Primitive(0.099, 0.07, 0.009),),
        (Region(0.0, -0.133, 0.057),),
        _ALL,
        2.8,
    ),
    ObjectType(
        "pencil_case", (Primitive(0.037, 0.072, 0.007),), (Region(0.087, 0.0, 0.046),), _ALL, 0.25
    ),
    ObjectType(
        "tissue_box", (Primitive(0.049, 0.04, 0.009),), (Region(0.0, -0.103, 0.047),), _QUARTER, 0.3
    ),
    ObjectType("pen_cup", (_disk(0.034),), (Region(0.083, 0.0, 0.039),), _ALL, 0.3),
)

NAMES: tuple[str, ...] = tuple(kind.name for kind in LIBRARY)
MAX_OBJECTS = len(LIBRARY)
MAX_LARGE = 10_000  # objects of a large scene, where types repeat
_BY_NAME = {kind.name: kind for kind in LIBRARY}
_NUMBER = re.compile(r"[1-9][0-9]{0,6}")


def type_name(name: str) -> str:
    """The name of an object's type by the object's name: "teacup" and "teacup#2" are two teacups."""
    return name.partition("#")[0]


def object_type(name: str) -> ObjectType:
    """The type of the object by that name."""
    return _BY_NAME[type_name(name)]


def is_object_name(name: str) -> bool:
    """Whether a name is that of a type, alone or with a number from 2 on that distinguishes objects of one type."""
    kind, sign, number = name.partition("#")
    numbered = not sign or (_NUMBER.fullmatch(number) is not None and number != "1")
    return kind in _BY_NAME and numbered


def numbered(types: Iterable[str]) -> tuple[str, ...]:
    """Names of objects of the given types: the type alone for the first one, then with "#2", "#3", ..."""
    count: Counter[str] = Counter()
    names = []
    for kind in types:
        count[kind] += 1
        names.append(kind if count[kind] == 1 else f"{kind}#{count[kind]}")
    return tuple(names)
