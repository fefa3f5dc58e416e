"""A plan as an MJCF file: floor, obstacles, bounds, goals and paths, and robots that drive.

World frame: that of the map, z = 0 on the floor; m and rad.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError
from deggflow.tasks.fleet.condition import triangles
from deggflow.tasks.fleet.plan import Plan
from deggflow.view import mjcf
from deggflow.view.colours import Colour, accent, blend, rgb
from deggflow.view.solids import box, box_between, drum

from .robots import ADD, FLOOR, HIGH, HULL, Drive, Start, exact, robot_name

TIMESTEP = 0.002  # s, of MuJoCo
RADII = 0.05, 2.0  # m, of robots that wheels and servos are made for

_FLOOR, _OBSTACLE, _WALL = rgb("#f4f2ec"), rgb("#9b958a"), rgb("#cdc7ba")
_TALL, _WALL_HEIGHT, _WALL_WIDTH = 1.0, 0.5, 0.5  # of obstacles and of the bounds, in radii
_LINE, _GOAL, _THIN = (
    0.08,
    0.5,
    0.01,
)  # half width of paths, radius of goals, their height, in radii
_SLIVER = 1e-10  # m^2, triangles below are no bodies
_SHORT = 1e-4  # m, steps below are not drawn
_FOVY, _TOP_FOVY, _ELEVATION = 30.0, 8.0, math.radians(62.0)


@dataclass(frozen=True)
class Scale:
    """How large and how fast a plan is.

    Attributes:
        metres: Of a map unit.
        seconds: From a waypoint to the next.
    """

    metres: float = 4.0
    seconds: float = 1.0


def fleet_mjcf(
    plan: Plan, drive: Drive = "omni", scale: Scale | None = None, *, aspect: float = 4 / 3
) -> str:
    """A plan's floor and robots as MJCF text that MuJoCo loads; robots stand at their starts.

    Args:
        plan: What is to be driven.
        drive: Of the robots.
        scale: Metres of a map unit; its seconds do not matter here.
        aspect: Width over height of the pictures; the cameras are placed for it.

    Returns:
        Bodies "robot_1", ..., with velocity servos "robot_1_x" and "robot_1_y" (m/s) or "robot_1_left" and
        "robot_1_right" (rad/s); cameras "studio" and "top".

    Raises:
        InputError: If the robots are too small or too large to be driven.

    Example:
        >>> from deggflow.tasks.fleet.condition import FleetCondition, Robot
        >>> from deggflow.certificate import Certificate
        >>> condition = FleetCondition("empty", (Robot((0.0, 0.0), (0.5, 0.0)),))
        >>> straight = np.linspace(condition.starts, condition.goals, 64, axis=1)
        >>> plan = Plan(condition, straight, Certificate(True, 0.1, 0.0, 1, None), seed=0)
        >>> fleet_mjcf(plan).count("<velocity")
        2
    """
    scale = Scale() if scale is None else scale
    condition, metres = plan.condition, scale.metres
    radius = condition.radius * metres
    if not RADII[0] <= radius <= RADII[1]:
        raise InputError(
            f"robots of radius {condition.radius:g} have {radius:g} m where a map unit has {metres:g} m; "
            f"MuJoCo drives robots of {RADII[0]:g} to {RADII[1]:g} m: change --metres"
        )
    left, low, right, high = (metres * each for each in condition.floor.bounds)
    extent = math.hypot(right - left, high - low) / 2
    model = mjcf.new_model("fleet", extent=extent, size=(1920, 1440), fovy=_FOVY, stacks=8)
    middle = mjcf.numbers([(left + right) / 2, (low + high) / 2, 0.0])
    statistic = model.root.find("statistic")
    assert statistic is not None
    statistic.set("center", middle)
    option = {"timestep": exact(TIMESTEP), "integrator": "implicitfast", "cone": "elliptic"}
    SubElement(model.root, "option", option)
    still = {"contype": "0", "conaffinity": "0", "mass": "0"}  # what nothing touches
    SubElement(model.default, "geom", still)
    _add_surroundings(model.world, (left, low, right, high), radius, aspect)
    _add_obstacles(model.assets, model.world, plan, metres, radius)
    servos = SubElement(model.root, "actuator")
    paths = metres * plan.paths
    for robot, (path, goal) in enumerate(zip(paths, condition.goals, strict=True)):
        colour = accent(robot)
        height = (1 + robot / 4) * _THIN * radius  # each its own, for the depth buffer
        pale = blend(colour, _FLOOR, 0.45)
        disc = drum(_GOAL * radius, 0.0, height, pale, *(metres * goal))
        mjcf.add_solid(model.world, disc)
        _add_line(model.world, path, _LINE * radius, height, pale)
        start = Start(float(path[0, 0]), float(path[0, 1]), first_heading(path))
        ADD[drive](model.world, servos, robot_name(robot), radius, start, colour)
    return mjcf.model_text(model)


def first_heading(path: Float[np.ndarray, "waypoints 2"]) -> float:
    """Direction (rad) of the first step of a path that is one."""
    steps = np.diff(path, axis=0)
    moves = np.flatnonzero(np.hypot(steps[:, 0], steps[:, 1]) > _SHORT)
    x, y = steps[moves[0]] if len(moves) else (1.0, 0.0)
    return math.atan2(y, x)


def _add_surroundings(
    world: Element, bounds: tuple[float, float, float, float], radius: float, aspect: float
) -> None:
    """Floor, light and cameras, and the bounds as low walls."""
    left, low, right, high = bounds
    size = max(right - left, high - low)
    mjcf.add_light(world, (left - size, low - size, 3 * size), specular=0.0)
    edge, tall = _WALL_WIDTH * radius, HIGH * radius
    corners = (left - edge, low - edge, 0.0), (right + edge, high + edge, tall)
    studio = mjcf.Direction(_ELEVATION, 0.0, _FOVY)
    mjcf.add_fitted_camera(world, "studio", studio, *corners, aspect)
    top = mjcf.Direction(math.pi / 2, 0.0, _TOP_FOVY)
    mjcf.add_fitted_camera(world, "top", top, *corners, aspect)
    half = mjcf.numbers([(right - left) / 2, (high - low) / 2, 1.0])
    place = mjcf.numbers([(left + right) / 2, (low + high) / 2, 0.0])
    look = {"pos": place, "rgba": mjcf.numbers([*_FLOOR, 1.0])}
    SubElement(world, "geom", {"name": "floor", "type": "plane", "size": half, **look, **FLOOR})
    heights = (0.0, _WALL_HEIGHT * radius)
    x, y = (left - edge, right + edge), (low - edge, high + edge)
    walls = {
        "left": ((x[0], left), y), "right": ((right, x[1]), y),
        "front": (x, (y[0], low)), "back": (x, (high, y[1])),
    }  # fmt: skip
    for name, (along, across) in walls.items():
        wall = box_between(along, across, heights, _WALL)
        mjcf.add_solid(world, wall, name=f"bound_{name}").attrib.update(HULL)


def _add_obstacles(
    assets: Element, world: Element, plan: Plan, metres: float, radius: float
) -> None:
    """Boxes, discs, and polygons as prisms over triangles."""
    floor, tall = plan.condition.floor, _TALL * radius
    solids = [
        box_between((x - w / 2, x + w / 2), (y - h / 2, y + h / 2), (0.0, tall), _OBSTACLE)
        for x, y, w, h in metres * np.reshape(floor.boxes, (-1, 4))
    ]
    for x, y, size in metres * np.reshape(floor.discs, (-1, 3)):
        solids.append(drum(size, 0.0, tall, _OBSTACLE, x, y))
    for solid in solids:
        mjcf.add_solid(world, solid).attrib.update(HULL)
    for k, corners in enumerate(metres * triangles(floor)):
        (ax, ay), (bx, by) = corners[1:] - corners[0]
        if ax * by - ay * bx > 2 * _SLIVER:
            prism = [[*corner, z] for z in (0.0, tall) for corner in corners]
            SubElement(assets, "mesh", name=f"prism_{k + 1}", vertex=exact(*np.ravel(prism)))
            look = {"type": "mesh", "mesh": f"prism_{k + 1}", "rgba": mjcf.numbers([*_OBSTACLE, 1])}
            SubElement(world, "geom", {**look, **HULL})


def _add_line(
    world: Element,
    path: Float[np.ndarray, "waypoints 2"],
    reach: float,
    height: float,
    colour: Colour,
) -> None:
    """A path as a line on the floor, which reaches so far to either side."""
    for a, b in pairwise(path):
        x, y = b - a
        if math.hypot(x, y) > _SHORT:
            half = math.hypot(x, y) / 2 + reach, reach, height / 2
            at = (*(a + b) / 2, height / 2)
            mjcf.add_solid(world, box(half, at, colour, (math.atan2(y, x), 0.0, 0.0)))
