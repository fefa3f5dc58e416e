"""What robots are in MuJoCo: bodies, servos, and the commands that move them. Lengths in m, angles in rad.

An omnidirectional robot is a disc on two slide joints, each with a velocity servo. A differential-drive robot is a disc
with a free joint that stands on two driven wheels and a caster, and rolls by friction. Its axle lies behind its centre, so
turning and driving together move the centre in any direction.
"""

from typing import Literal, NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from jaxtyping import Float

from deggflow.view import mjcf
from deggflow.view.colours import Colour, rgb
from deggflow.view.solids import Solid, box, drum

Drive = Literal["omni", "differential"]

MASS = 1250.0  # kg / m^3, of a robot over its radius cubed: 10 kg with a radius of 0.2 m
LAG = 0.05  # s, time constant of velocity servos
# Lengths of a robot, in radii.
LOW, HIGH = 0.12, 0.92  # lower and upper face of the disc
AHEAD = 0.4  # of the centre from the axle, and of the caster from the centre
TRACK = 0.65  # of each wheel from the middle of the axle
WHEEL, HALF_WIDTH, CASTER = 0.22, 0.07, 0.1  # radius and half width of wheels, radius of the caster
WHEEL_MASS = 0.02  # of each wheel, over the robot's
GRIP = 1.0  # friction of wheels on the floor
# contype and conaffinity: hulls touch hulls and obstacles; wheels and casters touch the floor.
HULL = {"contype": "2", "conaffinity": "2"}
FLOOR, ROLLS = {"contype": "0", "conaffinity": "1"}, {"contype": "1", "conaffinity": "0"}

_DARK = rgb("#2b2f36")


class Start(NamedTuple):
    """Where a robot begins.

    Attributes:
        x: Of its centre, m.
        y: Of its centre, m.
        heading: Of its front, rad; an omnidirectional robot has none.
    """

    x: float
    y: float
    heading: float


def robot_name(robot: int) -> str:
    """Name of a robot's body, counted from 0."""
    return f"robot_{robot + 1}"


def add_omni(
    world: Element, servos: Element, name: str, radius: float, start: Start, colour: Colour
) -> None:
    """A disc on slide joints `<name>_x` and `<name>_y`, whose coordinates are the place of its centre (m)."""
    place = exact(start.x, start.y)
    body = SubElement(world, "body", name=name, pos=f"{place} 0")
    for letter, axis, at in (("x", "1 0 0", start.x), ("y", "0 1 0", start.y)):
        joint = {"name": f"{name}_{letter}", "type": "slide", "axis": axis, "ref": exact(at)}
        SubElement(body, "joint", joint)
        kv = exact(MASS * radius**3 / LAG)
        SubElement(servos, "velocity", name=f"{name}_{letter}", joint=f"{name}_{letter}", kv=kv)
    _add_hull(body, radius, MASS * radius**3, colour)


def add_differential(
    world: Element, servos: Element, name: str, radius: float, start: Start, colour: Colour
) -> None:
    """A disc with a free joint on wheels `<name>_left` and `<name>_right`, driven by servos of their speed (rad/s)."""
    turn = exact(*mjcf.yaw_quaternion(start.heading))
    body = SubElement(world, "body", name=name, pos=f"{exact(start.x, start.y)} 0", quat=turn)
    SubElement(body, "freejoint", name=name)
    whole = MASS * radius**3
    _add_hull(body, radius, (1 - 2 * WHEEL_MASS) * whole, colour)
    ball = {"type": "sphere", "size": exact(CASTER * radius), "condim": "1", "priority": "1"}
    at = exact(AHEAD * radius, 0.0, CASTER * radius)
    SubElement(body, "geom", {"pos": at, **ball, **ROLLS})
    for side, sign in (("left", 1), ("right", -1)):
        pos = exact(-AHEAD * radius, sign * TRACK * radius, WHEEL * radius)
        wheel = SubElement(body, "body", name=f"{name}_{side}", pos=pos)
        SubElement(wheel, "joint", name=f"{name}_{side}", type="hinge", axis="0 1 0")
        ends = exact(0.0, -HALF_WIDTH * radius, 0.0, 0.0, HALF_WIDTH * radius, 0.0)
        shape = {"type": "cylinder", "size": exact(WHEEL * radius), "fromto": ends}
        grip = {"friction": exact(GRIP, 0.005, 0.0001), "mass": exact(WHEEL_MASS * whole)}
        look = {"rgba": mjcf.numbers([*_DARK, 1.0])}
        SubElement(wheel, "geom", {**shape, **grip, **look, **ROLLS})
        kv = exact(whole * (WHEEL * radius) ** 2 / (2 * LAG))
        SubElement(servos, "velocity", name=f"{name}_{side}", joint=f"{name}_{side}", kv=kv)


ADD = {"omni": add_omni, "differential": add_differential}


def _add_hull(body: Element, radius: float, mass: float, colour: Colour) -> None:
    """The disc, and a lid with a mark at its front."""
    hull = mjcf.add_solid(body, drum(radius, LOW * radius, HIGH * radius, colour))
    hull.attrib.update(name=f"{body.get('name')}_hull", mass=exact(mass), **HULL)
    top = HIGH * radius
    mjcf.add_solid(body, drum(0.8 * radius, top, top + 0.02 * radius, _DARK))
    mjcf.add_solid(body, _mark(radius, top + 0.04 * radius, colour))


def _mark(radius: float, height: float, colour: Colour) -> Solid:
    """From the centre to the front."""
    return box((0.35 * radius, 0.1 * radius, 0.02 * radius), (0.35 * radius, 0.0, height), colour)


def exact(*values: float) -> str:
    """Numbers of an attribute, of every size, to rounding of float64."""
    return " ".join(repr(float(value)) for value in values)


def wheel_speeds(
    velocity: Float[np.ndarray, "robots 2"], heading: Float[np.ndarray, " robots"], radius: float
) -> Float[np.ndarray, "robots 2"]:
    """Speeds (rad/s) of the left and the right wheel that move the centres with a velocity (m/s).

    The centre lies `AHEAD` radii ahead of the axle: it moves along the heading by driving, and across it by turning.
    """
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    drive = np.sum(ahead * velocity, axis=-1)
    turn = np.sum(across * velocity, axis=-1) / (AHEAD * radius)
    sides = TRACK * radius * np.array([-1.0, 1.0])
    return (drive[:, None] + turn[:, None] * sides) / (WHEEL * radius)
