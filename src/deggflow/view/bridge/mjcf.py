"""The bridge scene as an MJCF file: grounds, pit, goals, and mocap bodies for plank and robots.

World frame: that of the task, z = 0 on the ground; m and rad.
"""

import math
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from jaxtyping import Float

from deggflow.tasks.bridge.world import (
    PLANK_LENGTH,
    PLANK_WIDTH,
    ROBOT_RADIUS,
    X_MAX,
    X_MIN,
    Y_MAX,
    Y_MIN,
)
from deggflow.view import mjcf
from deggflow.view.colours import accent

from .moment import PIT_DEPTH
from .parts import (
    MARGIN_X,
    MARGIN_Y,
    plank,
    plank_outline,
    ring_mesh,
    robot,
    surroundings,
)

PLANK = "plank"  # name of its body

_FOVY, _TOP_FOVY = 30.0, 8.0  # deg; the top camera looks from far away, almost in parallel rays
_ELEVATION, _AZIMUTH = math.radians(58.0), math.radians(9.0)  # of the studio camera
_HEADROOM = 0.25  # m above the ground that cameras keep in the picture
_SHADOW = (0.10, 0.08, 0.05, 0.22)  # rgba of what lies below a robot or the plank
_FRINGE = 0.035  # m, how far the plank's shadow reaches beyond it


def robot_name(robot: int) -> str:
    """Name of a robot's body, counted from 0."""
    return f"robot_{robot + 1}"


def bridge_mjcf(
    robot_goals: Float[np.ndarray, "robots 2"],
    plank_goal: Float[np.ndarray, " 3"],
    *,
    aspect: float = 16 / 9,
) -> str:
    """The scene as MJCF text that MuJoCo loads, plank and robots at the origin.

    Args:
        robot_goals: Where each robot has to go (m); as many robots are in the scene.
        plank_goal: Pose (m, m, rad) of the plank's goal.
        aspect: Width over height of the pictures; the cameras are placed for it.

    Returns:
        Mocap bodies "plank" and "robot_1", ...; cameras "studio" and "top".
    """
    model = mjcf.new_model(
        "bridge", extent=(X_MAX - X_MIN) / 2, size=(1920, 1080), fovy=_FOVY, stacks=16
    )
    SubElement(model.visual, "map", znear="0.1")
    SubElement(model.default, "geom", contype="0", conaffinity="0")  # nothing touches anything
    _add_meshes(model.assets)
    world = model.world
    mjcf.add_light(world, (-2.0, -4.0, 9.0), specular=0.0)
    low = X_MIN - MARGIN_X, Y_MIN - MARGIN_Y, -PIT_DEPTH
    high = X_MAX + MARGIN_X, Y_MAX + MARGIN_Y, _HEADROOM
    studio = mjcf.Direction(_ELEVATION, _AZIMUTH, _FOVY)
    mjcf.add_fitted_camera(world, "studio", studio, low, high, aspect)
    top = mjcf.Direction(math.pi / 2, 0.0, _TOP_FOVY)
    mjcf.add_fitted_camera(world, "top", top, low, high, aspect)
    for solid in surroundings():
        mjcf.add_solid(world, solid)
    _add_goals(world, robot_goals, plank_goal)
    _add_plank(world)
    for i in range(len(robot_goals)):
        _add_robot(world, i)
    return mjcf.model_text(model)


def _add_goals(
    world: Element, robots: Float[np.ndarray, "robots 2"], pose: Float[np.ndarray, " 3"]
) -> None:
    for i, (x, y) in enumerate(robots):
        look = {"type": "mesh", "mesh": "goal_ring", "rgba": mjcf.numbers([*accent(i), 1.0])}
        SubElement(
            world, "geom", {"name": f"goal_{i + 1}", "pos": mjcf.numbers([x, y, 0.0]), **look}
        )
    frame = SubElement(
        world,
        "body",
        name="plank_goal",
        pos=mjcf.numbers([pose[0], pose[1], 0.0]),
        quat=mjcf.numbers(mjcf.yaw_quaternion(pose[2])),
    )
    for solid in plank_outline():
        mjcf.add_solid(frame, solid).set("rgba", mjcf.numbers([*solid.colour, 0.75]))


def _add_plank(world: Element) -> None:
    body = SubElement(world, "body", name=PLANK, mocap="true")
    size = PLANK_LENGTH / 2 + _FRINGE, PLANK_WIDTH / 2 + _FRINGE, 0.00125
    shadow = {"type": "box", "size": mjcf.numbers(size), "pos": mjcf.numbers([0.0, 0.0, size[2]])}
    SubElement(body, "geom", {"rgba": mjcf.numbers(_SHADOW), **shadow})
    for solid in plank():
        mjcf.add_solid(body, solid)


def _add_robot(world: Element, index: int) -> None:
    body = SubElement(world, "body", name=robot_name(index), mocap="true")
    shadow = {"type": "cylinder", "size": mjcf.numbers([1.12 * ROBOT_RADIUS, 0.0015])}
    place = mjcf.numbers([0.035, 0.03, 0.0025])
    SubElement(body, "geom", {"pos": place, "rgba": mjcf.numbers(_SHADOW), **shadow})
    for k, solid in enumerate(robot(accent(index))):
        mjcf.add_solid(body, solid, mesh=mjcf.mesh_name("robot", k))


def _add_meshes(assets: Element) -> None:
    """All robots have one shape, and all goals."""
    mjcf.add_frustum_meshes(assets, "robot", robot(accent(0)))
    corners, faces = ring_mesh(0.95 * ROBOT_RADIUS, 1.4 * ROBOT_RADIUS, 0.002)
    triangles = " ".join(str(corner) for corner in faces.ravel())
    SubElement(
        assets, "mesh", name="goal_ring", vertex=mjcf.numbers(corners.ravel()), face=triangles
    )
