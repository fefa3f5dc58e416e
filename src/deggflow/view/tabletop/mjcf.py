"""A scene as an MJCF file: table, objects, affordance regions and cameras.

World frame: x to the right, y away from the viewer, z = 0 on the table's surface; m and rad.
Objects are mocap bodies, so that `data.mocap_pos` and `data.mocap_quat` move them without another
compilation.
"""

import math
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from jaxtyping import Float

from deggflow.tasks.tabletop.condition import Balance, SceneCondition
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.verdict import Verdict, judge
from deggflow.view import mjcf
from deggflow.view.colours import Colour, rgb
from deggflow.view.solids import Solid

from .bodies import slab, solids_of
from .marks import Disc, Marks, centre_of_mass, checked_poses, discs_of, marks_of

ASPECT = 4 / 3  # width over height that the cameras are framed for
FREE = (0.13, 0.64, 0.36, 0.42)  # rgba of a region that is free
BLOCKED = (0.86, 0.12, 0.10, 0.50)  # rgba of a region that is obstructed or over the edge
OUTLINE = (0.86, 0.05, 0.05, 1.0)  # rgba of the rim around an object that overlaps
BALANCE = (0.0, 0.45, 0.70, 1.0)  # rgba of circle and centre of mass
HIDDEN = (0.0, 0.0, 0.0, 0.0)

_TABLE, _EDGE, _LEG = rgb("#ebe5da"), rgb("#cbbfae"), rgb("#a89b89")
_SHADE = rgb("#d3cabb")  # the table's surface below an object
_THICKNESS, _LEG_LENGTH, _LEG_HALF = 0.030, 0.70, 0.022  # m
_RIM, _RIM_HEIGHT = 0.008, 0.004  # m, how far the red rim reaches beyond the footprint, and up
_DISC = 0.0009  # m, height of the lowest region's face; each further one lies _DISC_STEP above
_DISC_STEP = 0.00008  # m, keeps faces of overlapping regions apart in the depth buffer
CENTRE_OF_MASS, BEADS = "centre_of_mass", "balance_"
_BEADS, _BEAD, _PIN = 48, 0.003, 0.16  # radius and height of the pin, m
_FOVY, _TOP_FOVY = 22.0, 9.0  # deg; the top camera looks from far away, almost in parallel rays
_ELEVATION = math.radians(56.0)  # of the studio camera
_HEADROOM = 0.10  # m above the table that the studio camera keeps in the picture


def scene_mjcf(
    condition: SceneCondition,
    poses: Float[np.ndarray, "agents 3"],
    verdict: Verdict | None = None,
) -> str:
    """The scene as MJCF text that MuJoCo loads; the same scene gives the same text.

    Args:
        condition: Objects, requirements and table.
        poses: x, y (m) and theta (rad) of each object.
        verdict: Decides what is red; exact geometry is asked if it is not given.

    Returns:
        One body per object, named after it; regions as `<object>_region_<k>` of class "free" or
        "blocked"; a ring "balance" and a pin "centre_of_mass" where the condition asks for balance; a rim of class "outline" around objects that overlap or reach over the edge;
        cameras "studio" and "top".
    """
    rows = checked_poses(condition, poses)
    verdict = judge([condition], [rows])[0] if verdict is None else verdict
    return _scene(condition, rows, marks_of(verdict), every_outline=False)


def stage_mjcf(condition: SceneCondition) -> str:
    """The scene with every object at the origin and every rim hidden, to be moved and coloured."""
    nothing = Marks(frozenset(), frozenset())
    return _scene(condition, np.zeros((len(condition.objects), 3)), nothing, every_outline=True)


def region_name(name: str, region: int) -> str:
    """Name of the geom of an object's affordance region, counted from 0."""
    return f"{name}_region_{region + 1}"


def outline_names(name: str) -> list[str]:
    """Names of the geoms that make up an object's red rim."""
    return [f"{name}_outline_{k + 1}" for k in range(len(_outline(name)))]


def _scene(
    condition: SceneCondition,
    poses: Float[np.ndarray, "agents 3"],
    marks: Marks,
    *,
    every_outline: bool,
) -> str:
    extent = math.hypot(condition.width, condition.depth) / 2
    model = mjcf.new_model("tabletop", extent=extent, size=(1920, 1440), fovy=_FOVY, stacks=8)
    _add_classes(model.default)
    for name in condition.objects:
        mjcf.add_frustum_meshes(model.assets, name, solids_of(name))
    world = model.world
    _add_surroundings(world, condition)
    layer = 0
    for i, (name, (x, y, theta)) in enumerate(zip(condition.objects, poses, strict=True)):
        quat = mjcf.numbers(mjcf.yaw_quaternion(theta))
        body = SubElement(
            world, "body", name=name, mocap="true", pos=mjcf.numbers([x, y, 0.0]), quat=quat
        )
        for solid in _shade(name):
            mjcf.add_solid(body, solid)
        for k, solid in enumerate(solids_of(name)):
            mjcf.add_solid(body, solid, mesh=mjcf.mesh_name(name, k))
        for k, disc in enumerate(discs_of(condition, name)):
            _add_region(body, region_name(name, k), disc, (i, k) in marks.blocked, layer)
            layer += 1
        if every_outline or i in marks.outlined:
            for part, solid in zip(outline_names(name), _outline(name), strict=True):
                geom = mjcf.add_solid(body, solid, coloured=False, name=part)
                geom.set("class", "outline")
                if i not in marks.outlined:
                    geom.set("rgba", mjcf.numbers(HIDDEN))
    if condition.balance is not None:
        centre = centre_of_mass(condition, poses)
        _add_balance(world, condition.balance, centre, marks.unbalanced, layer)
    return mjcf.model_text(model)


def _add_classes(default: Element) -> None:
    # The mocap bodies never collide with each other, a robot put into the scene does touch them.
    for kind, colour in (("free", FREE), ("blocked", BLOCKED), ("outline", OUTLINE)):
        geom = SubElement(SubElement(default, "default", {"class": kind}), "geom")
        geom.attrib.update(contype="0", conaffinity="0", group="1", rgba=mjcf.numbers(colour))


def _add_surroundings(world: Element, condition: SceneCondition) -> None:
    half_x, half_y = condition.width / 2, condition.depth / 2
    mjcf.add_light(world, (-1.0, -1.0, 3.0), specular=0.08)
    _add_camera(world, "studio", _ELEVATION, _FOVY, condition)
    _add_camera(world, "top", math.pi / 2, _TOP_FOVY, condition)
    table = SubElement(world, "body", name="table")
    lip = 0.004  # m, the visible upper face is a sheet on a slightly darker board
    parts = [
        Solid("box", (half_x, half_y, lip / 2), _TABLE, (0.0, 0.0, -lip / 2)),
        Solid(
            "box",
            (half_x, half_y, (_THICKNESS - lip) / 2),
            _EDGE,
            (0.0, 0.0, -(_THICKNESS + lip) / 2),
        ),
    ]
    reach = _LEG_HALF + 0.02
    for sx in (-1, 1):
        for sy in (-1, 1):
            at = (sx * (half_x - reach), sy * (half_y - reach), -_THICKNESS - _LEG_LENGTH / 2)
            parts.append(Solid("box", (_LEG_HALF, _LEG_HALF, _LEG_LENGTH / 2), _LEG, at))
    for solid in parts:
        mjcf.add_solid(table, solid)


def _add_camera(
    world: Element, name: str, elevation: float, fovy: float, condition: SceneCondition
) -> None:
    """A camera in front of the table, just so far away that it fits a picture of shape ASPECT."""
    half_x, half_y = 1.04 * condition.width / 2, 1.04 * condition.depth / 2
    sin, cos = math.sin(elevation), math.cos(elevation)
    tangent = math.tan(math.radians(fovy) / 2)
    target = np.array([0.0, 0.0, _HEADROOM / 2 * cos])
    distance = 0.0
    for y in (-half_y, half_y):
        for z in (-_THICKNESS, _HEADROOM) if cos > 1e-6 else (0.0,):
            up = y * sin + (z - target[2]) * cos
            back = -y * cos + (z - target[2]) * sin
            distance = max(distance, back + abs(up) / tangent, back + half_x / (tangent * ASPECT))
    pos = target + distance * np.array([0.0, -cos, sin])
    mjcf.add_camera(world, name, pos, (1.0, 0.0, 0.0), (0.0, sin, cos), fovy)


def _add_region(body: Element, name: str, disc: Disc, blocked: bool, layer: int) -> None:
    geom = SubElement(body, "geom", {"name": name, "class": "blocked" if blocked else "free"})
    face = _DISC + layer * _DISC_STEP
    geom.set("type", "cylinder")
    geom.set("size", mjcf.numbers([disc.radius, face / 2]))
    geom.set("pos", mjcf.numbers([disc.x, disc.y, face / 2]))


def _add_balance(
    world: Element,
    balance: Balance,
    centre: Float[np.ndarray, " 2"],
    unbalanced: bool,
    layer: int,
) -> None:
    """The circle for the centre of mass as a rim of beads on the table, and a pin where it lies."""
    look = {"class": "outline", "rgba": mjcf.numbers(OUTLINE if unbalanced else BALANCE)}
    circle = SubElement(world, "body", name="balance")
    for k in range(_BEADS):
        angle = 2 * math.pi * k / _BEADS
        x = balance.x + balance.radius * math.cos(angle)
        y = balance.y + balance.radius * math.sin(angle)
        at = {
            "size": mjcf.numbers([_BEAD]),
            "pos": mjcf.numbers([x, y, _DISC + layer * _DISC_STEP]),
        }
        SubElement(circle, "geom", {"name": f"{BEADS}{k + 1}", "type": "sphere", **at, **look})
    place = mjcf.numbers([*centre, 0.0])
    body = SubElement(world, "body", name=CENTRE_OF_MASS, mocap="true", pos=place)
    pin = {
        "type": "capsule",
        "size": mjcf.numbers([_BEAD]),
        "fromto": mjcf.numbers([0, 0, 0, 0, 0, _PIN]),
    }
    SubElement(body, "geom", {"name": CENTRE_OF_MASS, **pin, **look})
    head = {"type": "sphere", "size": mjcf.numbers([3 * _BEAD]), "pos": mjcf.numbers([0, 0, _PIN])}
    SubElement(body, "geom", {"name": f"{CENTRE_OF_MASS}_head", **head, **look})


def balance_names() -> list[str]:
    """Names of the geoms that show the balance."""
    return [f"{BEADS}{k + 1}" for k in range(_BEADS)] + [CENTRE_OF_MASS, f"{CENTRE_OF_MASS}_head"]


def _flat(name: str, height: float, grow: float, colour: Colour) -> list[Solid]:
    return [
        solid
        for part in object_type(name).primitives
        for solid in slab(part, 0.0, height, colour, grow)
    ]


def _shade(name: str) -> list[Solid]:
    """The exact footprint as a darker patch: what counts as the object's shape."""
    return _flat(name, 0.0004, 0.0, _SHADE)


def _outline(name: str) -> list[Solid]:
    return _flat(name, _RIM_HEIGHT, _RIM, OUTLINE[:3])
