"""What the twelve objects of the tabletop library look like, within the library's footprints.

The front of most objects faces -y, where their affordance regions lie by default.
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

from deggflow.tasks.tabletop.library import Primitive, object_type, type_name
from deggflow.view.colours import Colour, rgb
from deggflow.view.solids import Solid, ball, box, drum, ring, rod, rotation, rounded_slab, turned

_WHITE, _PAPER = rgb("#f4f3ef"), rgb("#fbfaf5")
_DARK, _BLACK = rgb("#3a3f47"), rgb("#22252a")
_STEEL, _SILVER = rgb("#aab1ba"), rgb("#c3c7cd")
_WOOD, _PALE_WOOD, _DEEP_WOOD = rgb("#b98a5a"), rgb("#d9bb8d"), rgb("#8a6238")
_BLUE, _PALE_BLUE, _NAVY = rgb("#3d6fa8"), rgb("#8db3d6"), rgb("#2b3f63")
_YELLOW, _ORANGE, _PURPLE = rgb("#e9bc45"), rgb("#e0872c"), rgb("#6f5a9c")


@cache
def solids_of(name: str) -> tuple[Solid, ...]:
    """The solids of one object by its library name, listed from the bottom up."""
    return tuple(_BUILDERS[type_name(name)]())


def slab(
    shape: Primitive, bottom: float, top: float, colour: Colour, grow: float = 0.0
) -> list[Solid]:
    """An upright slab over a footprint of the library, or `grow` beyond its outline."""
    half, centre = (shape.half_x, shape.half_y), (shape.x, shape.y)
    return rounded_slab(half, shape.corner, (bottom, top), colour, centre=centre, grow=grow)


def _drawer_organizer() -> list[Solid]:
    body = Primitive(0.156, 0.085, 0.012, 0.0, 0.005)
    out = slab(body, 0.0, 0.062, _WOOD)
    for x in (-0.1, 0.0, 0.1):  # one drawer in front of each affordance region
        out.append(box((0.046, 0.0015, 0.024), (x, -0.0805, 0.031), _PALE_WOOD))
        out.append(ball((0.0042, 0.0042, 0.0042), (x, -0.0845, 0.033), _DARK))
    out.append(box((0.148, 0.077, 0.0006), (0.0, 0.005, 0.0624), _DEEP_WOOD))
    for x in (-0.1535, -0.05, 0.05, 0.1535):
        out.append(box((0.0025, 0.073, 0.015), (x, 0.005, 0.077), _WOOD))
    for y in (-0.0775, 0.0875):
        out.append(box((0.144, 0.0025, 0.015), (0.0, y, 0.077), _WOOD))
    out += [
        drum(0.012, 0.062, 0.092, _WOOD, x, y) for x in (-0.144, 0.144) for y in (-0.068, 0.078)
    ]
    out.append(box((0.048, 0.0025, 0.015), (0.1, 0.01, 0.077), _WOOD))
    out.append(box((0.027, 0.027, 0.010), (0.098, 0.048, 0.073), _YELLOW, (0.12, 0.0, 0.0)))
    out.append(box((0.019, 0.010, 0.006), (0.103, -0.034, 0.069), _WHITE, (0.5, 0.0, 0.0)))
    for x, colour in ((-0.125, _BLUE), (-0.112, _ORANGE), (-0.099, _BLACK)):
        out.append(rod((x, -0.055, 0.068), (x + 0.012, 0.062, 0.068), 0.0042, colour))
    out += ring((0.0, 0.02, 0.068), 0.026, 0.006, _SILVER, pieces=20)  # a roll of tape
    return out


def _teacup() -> list[Solid]:
    glaze, tea = rgb("#e6eef5"), rgb("#9c5a2b")
    out = [drum(0.025, 0.0, 0.006, glaze)]
    out += turned([(0.025, 0.006), (0.036, 0.018), (0.042, 0.034), (0.0435, 0.052)], glaze)
    out.append(drum(0.0438, 0.043, 0.0455, _BLUE))  # a painted line
    out.append(drum(0.0405, 0.052, 0.0524, tea))
    out += ring((0.0, 0.0, 0.0528), 0.0425, 0.0026, glaze, pieces=24)
    out += ring((0.0595, 0.0, 0.031), 0.0155, 0.0044, glaze, plane="xz", arc=(-2.3, 2.3), pieces=14)
    return out


def _desk_lamp() -> list[Solid]:
    shade, warm = rgb("#e3a83a"), rgb("#fff3c4")
    out = turned([(0.06, 0.0), (0.06, 0.007), (0.056, 0.010)], _DARK)
    out.append(ball((0.014, 0.014, 0.008), (0.0, 0.036, 0.011), _STEEL))
    out.append(rod((0.0, 0.036, 0.012), (0.0, 0.047, 0.150), 0.0045, _STEEL))
    out.append(ball((0.0085, 0.0085, 0.0085), (0.0, 0.047, 0.152), _DARK))
    out.append(rod((0.0, 0.047, 0.152), (0.0, 0.004, 0.224), 0.0045, _STEEL))
    out.append(drum(0.047, 0.1705, 0.172, warm, 0.0, -0.006))
    out.append(ball((0.015, 0.015, 0.015), (0.0, -0.006, 0.170), warm))
    out += turned([(0.052, 0.172), (0.024, 0.218), (0.016, 0.230)], shade, y=-0.006)
    out.append(ball((0.010, 0.010, 0.006), (0.0, -0.006, 0.231), _DARK))
    return out


def _laptop() -> list[Solid]:
    out = slab(object_type("laptop").primitives[0], 0.0, 0.009, _SILVER)
    out.append(box((0.072, 0.0235, 0.0004), (0.0, 0.008, 0.0092), _BLACK))
    for row in range(4):
        out.append(box((0.069, 0.0042, 0.0009), (0.0, 0.0245 - 0.0112 * row, 0.0095), _DARK))
    out.append(box((0.022, 0.0135, 0.0005), (0.0, -0.0385, 0.0092), _STEEL))
    lean, hinge = 0.25, (0.036, 0.011)  # rad backwards; y and z of the hinge

    def on_lid(x: float, up: float, front: float) -> tuple[float, float, float]:
        y = hinge[0] + up * math.sin(lean) - front * math.cos(lean)
        return x, y, hinge[1] + up * math.cos(lean) + front * math.sin(lean)

    turn = (0.0, 0.0, -lean)
    out.append(box((0.080, 0.0026, 0.052), on_lid(0.0, 0.051, 0.0), _STEEL, turn))
    out.append(box((0.0765, 0.0006, 0.0475), on_lid(0.0, 0.052, 0.0028), _BLACK, turn))
    out.append(box((0.0735, 0.0006, 0.0445), on_lid(0.0, 0.052, 0.0032), rgb("#5b9bd5"), turn))
    out.append(box((0.034, 0.0006, 0.028), on_lid(-0.024, 0.055, 0.0038), _WHITE, turn))
    for k, half in enumerate((0.026, 0.020, 0.024, 0.014)):
        x = -0.024 - 0.028 + half
        out.append(box((half, 0.0004, 0.0018), on_lid(x, 0.073 - 0.011 * k, 0.0043), _STEEL, turn))
    out.append(box((0.022, 0.0006, 0.016), on_lid(0.040, 0.064, 0.0038), _YELLOW, turn))
    out.append(rod((-0.055, 0.036, 0.010), (0.055, 0.036, 0.010), 0.003, _DARK))
    return out


def _leaf(
    azimuth: float, rise: float, reach: float, height: float, half: float, light: bool
) -> Solid:
    at = (reach * math.cos(azimuth), reach * math.sin(azimuth), height)
    colour = rgb("#7aa556") if light else rgb("#4d7c41")
    return ball((half, 0.40 * half, 0.09 * half), at, colour, (azimuth, -rise, 0.0))


def _potted_plant() -> list[Solid]:
    clay, soil = rgb("#bb6a4c"), rgb("#4a3728")
    out = turned([(0.064, 0.0), (0.070, 0.008)], clay)
    out += turned([(0.037, 0.008), (0.050, 0.074)], clay)
    out += [drum(0.054, 0.072, 0.088, clay), drum(0.047, 0.088, 0.0885, soil)]
    for k in range(8):
        out.append(_leaf(0.2 + k * math.tau / 8, 0.30, 0.041, 0.108, 0.037, k % 2 == 0))
    for k in range(7):
        out.append(_leaf(0.5 + k * math.tau / 7, 0.75, 0.033, 0.132, 0.042, k % 2 == 1))
    for k in range(4):
        out.append(_leaf(1.1 + k * math.tau / 4, 1.20, 0.014, 0.150, 0.042, k % 2 == 0))
    return out


def _handled_mug() -> list[Solid]:
    y, inside = 0.0215, rgb("#5a3a25")
    out = turned([(0.041, 0.0), (0.0445, 0.004), (0.0445, 0.095)], _BLUE, y=y)
    out.append(drum(0.0449, 0.056, 0.070, _WHITE, 0.0, y))
    out.append(drum(0.0400, 0.095, 0.0954, inside, 0.0, y))
    out += ring((0.0, y, 0.0955), 0.0422, 0.0026, _BLUE, pieces=24)
    arc = (math.pi - 1.9, math.pi + 1.9)
    out += ring((0.0, -0.033, 0.048), 0.0270, 0.0065, _BLUE, plane="yz", arc=arc, pieces=16)
    return out


def _drawing_board() -> list[Solid]:
    tilt = 0.26  # rad, the front edge is the low one
    turn = (0.0, 0.0, tilt)

    def on_board(x: float, up: float, lift: float) -> tuple[float, float, float]:
        along = rotation(turn) @ [x, up, lift]
        return float(along[0]), float(along[1]), float(along[2]) + 0.0165

    out = [box((0.131, 0.047, 0.004), on_board(0.0, 0.0, 0.0), _PALE_WOOD, turn)]
    out += [box((0.006, 0.010, 0.009), (x, 0.032, 0.009), _DEEP_WOOD) for x in (-0.1, 0.1)]
    out.append(box((0.120, 0.0025, 0.0035), on_board(0.0, -0.0435, 0.0065), _DEEP_WOOD, turn))
    out.append(box((0.098, 0.037, 0.0006), on_board(-0.012, 0.002, 0.0045), _PAPER, turn))
    strokes = (  # x, up, half length, angle: a house with a roof
        (-0.060, -0.010, 0.024, 0.0), (-0.084, -0.002, 0.008, math.pi / 2),
        (-0.036, -0.002, 0.008, math.pi / 2), (-0.072, 0.014, 0.0145, 0.6),
        (-0.048, 0.014, 0.0145, -0.6), (0.032, -0.018, 0.036, 0.0), (0.022, -0.025, 0.026, 0.0),
    )  # fmt: skip
    for x, up, half, angle in strokes:
        along = (half * math.cos(angle), half * math.sin(angle))
        start = on_board(x - along[0], up - along[1], 0.0053)
        out.append(rod(start, on_board(x + along[0], up + along[1], 0.0053), 0.0008, _NAVY))
    angles = [k * math.tau / 16 for k in range(17)]
    circle = [
        on_board(0.03 + 0.017 * math.cos(a), 0.012 + 0.017 * math.sin(a), 0.0053) for a in angles
    ]
    out += [rod(a, b, 0.0008, _ORANGE) for a, b in pairwise(circle)]
    out.append(
        rod(on_board(0.104, -0.030, 0.0075), on_board(0.117, 0.034, 0.0075), 0.0033, _YELLOW)
    )
    out.append(
        rod(on_board(0.1028, -0.036, 0.0068), on_board(0.104, -0.030, 0.0075), 0.0014, _BLACK)
    )
    return out


def _scissors() -> list[Solid]:
    out: list[Solid] = []
    for side, height in ((1, 0.0045), (-1, 0.0075)):
        hole = (0.0225, side * 0.0124, height)
        out += ring(hole, 0.0095, 0.0031, _ORANGE, pieces=14)
        out.append(
            rod((0.013, side * 0.0088, height), (0.002, side * 0.0015, height), 0.0030, _ORANGE)
        )
        yaw = math.atan2(side * 0.0065, 0.034)
        out.append(
            box(
                (0.0180, 0.0028, 0.0011), (-0.0165, -side * 0.0031, height), _STEEL, (yaw, 0.0, 0.0)
            )
        )
        tip = (-0.0345, -side * 0.0066, height)
        out.append(rod((-0.030, -side * 0.0057, height), tip, 0.0016, _STEEL))
    out.append(drum(0.0030, 0.002, 0.0105, _DARK, 0.0, 0.0))
    return out


def _compact_printer() -> list[Solid]:
    shell, grey = rgb("#e3e4e6"), rgb("#8f969f")
    body = Primitive(0.098, 0.0505, 0.009, 0.0, 0.0190)
    out = slab(body, 0.0, 0.020, grey)
    out += slab(body, 0.020, 0.080, shell)
    out += slab(body, 0.080, 0.086, shell, grow=-0.006)
    out.append(box((0.070, 0.0012, 0.017), (0.0, -0.0315, 0.034), _BLACK))
    out.append(box((0.062, 0.0190, 0.0016), (0.0, -0.0485, 0.0130), grey, (0.0, 0.0, -0.06)))
    for x in (-0.060, 0.060):
        out.append(box((0.002, 0.0190, 0.005), (x, -0.0485, 0.0155), grey))
    out.append(box((0.048, 0.0200, 0.0008), (0.0, -0.0470, 0.0195), _PAPER, (0.0, 0.0, -0.14)))
    out.append(box((0.032, 0.0009, 0.0035), (0.0, -0.0325, 0.066), grey))
    out.append(box((0.020, 0.014, 0.0006), (-0.066, -0.005, 0.0864), _BLACK))
    out.append(box((0.017, 0.011, 0.0005), (-0.066, -0.005, 0.0868), _PALE_BLUE))
    out += [drum(0.0042, 0.086, 0.0875, grey, x, -0.005) for x in (-0.034, -0.020)]
    out.append(box((0.066, 0.0085, 0.002), (0.0, 0.050, 0.0865), _BLACK))
    out.append(box((0.058, 0.0012, 0.030), (0.0, 0.0545, 0.112), _PAPER, (0.0, 0.0, -0.20)))
    out.append(box((0.062, 0.0010, 0.022), (0.0, 0.0570, 0.104), grey, (0.0, 0.0, -0.20)))
    return out


def _pencil_case() -> list[Solid]:
    shape = object_type("pencil_case").primitives[0]
    out: list[Solid] = []
    soft = (  # height, and how far the outline is drawn in from there up
        (0.0, -0.003),
        (0.004, -0.001),
        (0.008, 0.0),
        (0.020, -0.0012),
        (0.024, -0.003),
        (0.0275, -0.006),
        (0.0295, 0.0),
    )
    for (bottom, grow), (top, _) in pairwise(soft):
        out += slab(shape, bottom, top, _PURPLE, grow=grow)
    out.append(box((0.0052, 0.0610, 0.0006), (0.0, 0.0, 0.0298), _BLACK))
    for k in range(19):
        out.append(box((0.0026, 0.0016, 0.0006), (0.0, -0.054 + 0.006 * k, 0.0303), _SILVER))
    out.append(box((0.0044, 0.0040, 0.0016), (0.0, -0.054, 0.0310), _YELLOW))
    out.append(rod((0.0, -0.058, 0.0318), (0.006, -0.066, 0.0312), 0.0022, _YELLOW))
    return out


def _tissue_box() -> list[Solid]:
    shape = object_type("tissue_box").primitives[0]
    out = slab(shape, 0.0, 0.064, _PALE_BLUE)
    out += slab(shape, 0.012, 0.018, _WHITE, grow=-0.0001)
    out.append(ball((0.030, 0.014, 0.0012), (0.0, 0.0, 0.064), _NAVY))
    for x, turn, half in (
        (-0.007, (0.35, 0.35, 0.30), (0.019, 0.0045, 0.027)),
        (0.007, (-0.45, -0.40, -0.25), (0.018, 0.0045, 0.024)),
        (0.001, (1.2, 0.10, 0.15), (0.011, 0.0050, 0.031)),
    ):
        out.append(ball(half, (x, 0.0, 0.078), _PAPER, turn))
    return out


def _pen_cup() -> list[Solid]:
    out = [drum(0.034, 0.0, 0.004, _DARK), drum(0.0325, 0.004, 0.084, _DARK)]
    out += [drum(0.0329, z, z + 0.004, _STEEL) for z in (0.014, 0.068)]
    out.append(drum(0.029, 0.084, 0.0843, _BLACK))
    out += ring((0.0, 0.0, 0.084), 0.0308, 0.0020, _DARK, pieces=20)
    for azimuth, top, colour in (
        (0.3, 0.136, _YELLOW), (1.6, 0.150, _BLUE), (2.8, 0.128, _PURPLE), (4.1, 0.142, _ORANGE),
        (5.3, 0.132, _WHITE),
    ):  # fmt: skip
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        foot, head = (0.010 * cos, 0.010 * sin, 0.07), (0.026 * cos, 0.026 * sin, top)
        out.append(rod(foot, head, 0.0040, colour))
        tip = tuple(h + 0.13 * (h - f) for f, h in zip(foot, head, strict=True))
        out.append(rod(head, (tip[0], tip[1], tip[2]), 0.0018, _BLACK))
    return out


_BUILDERS: dict[str, Callable[[], list[Solid]]] = {
    "drawer_organizer": _drawer_organizer,
    "teacup": _teacup,
    "desk_lamp": _desk_lamp,
    "laptop": _laptop,
    "potted_plant": _potted_plant,
    "handled_mug": _handled_mug,
    "drawing_board": _drawing_board,
    "scissors": _scissors,
    "compact_printer": _compact_printer,
    "pencil_case": _pencil_case,
    "tissue_box": _tissue_box,
    "pen_cup": _pen_cup,
}
