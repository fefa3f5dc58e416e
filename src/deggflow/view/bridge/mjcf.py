"""The bridge scene as an MJCF file: grounds, pit, goals, and mocap bodies for plank and robots.

World frame: that of the task, z = 0 on the ground; m and rad.
"""

import math
from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement, indent, tostring

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
from deggflow.view.solids import Solid, frustum_corners

from .moment import PIT_DEPTH
from .parts import (
    MARGIN_X,
    MARGIN_Y,
    accent,
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
_EDGE = 1.02  # how much larger than the ground the cameras' view is
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
    root = Element("mujoco", model="bridge")
    assets = _add_settings(root)
    world = SubElement(root, "worldbody")
    _add_camera(world, "studio", _ELEVATION, _AZIMUTH, _FOVY, aspect)
    _add_camera(world, "top", math.pi / 2, 0.0, _TOP_FOVY, aspect)
    for solid in surroundings():
        _add_solid(world, solid)
    _add_goals(world, robot_goals, plank_goal)
    _add_plank(world)
    for i in range(len(robot_goals)):
        _add_robot(world, i)
    _add_meshes(assets)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _add_settings(root: Element) -> Element:
    """Camera and light settings, a class of geoms that touch nothing; returns the list of assets."""
    SubElement(root, "compiler", angle="radian")
    SubElement(root, "statistic", center="0 0 0", extent=_numbers([(X_MAX - X_MIN) / 2]))
    visual = SubElement(root, "visual")
    SubElement(visual, "global", offwidth="1920", offheight="1080")
    SubElement(visual, "map", znear="0.1")
    SubElement(visual, "quality", offsamples="4", shadowsize="0", numslices="40", numquads="1")
    soft = {"ambient": "0.46 0.46 0.46", "diffuse": "0.2 0.2 0.2", "specular": "0 0 0"}
    SubElement(visual, "headlight", soft)
    SubElement(SubElement(root, "default"), "geom", contype="0", conaffinity="0")
    assets = SubElement(root, "asset")
    white = {"builtin": "flat", "rgb1": "1 1 1", "rgb2": "1 1 1", "width": "8", "height": "8"}
    SubElement(assets, "texture", {"name": "backdrop", "type": "skybox", **white})
    return assets


def _add_camera(
    world: Element, name: str, elevation: float, azimuth: float, fovy: float, aspect: float
) -> None:
    """A camera just so far away that its picture holds the grounds down to the pit's floor."""
    (se, ce), (sa, ca) = _sin_cos(elevation), _sin_cos(azimuth)
    right, up = np.array([ca, sa, 0.0]), np.array([-sa * se, ca * se, ce])
    axes = np.stack([right, up, np.cross(right, up)])
    low = np.array([X_MIN - MARGIN_X, Y_MIN - MARGIN_Y, -PIT_DEPTH])
    high = np.array([X_MAX + MARGIN_X, Y_MAX + MARGIN_Y, _HEADROOM])
    corners = np.array([[x, y, z] for x, y, z in np.ndindex(2, 2, 2)]) * (high - low) + low
    across, upward, back = axes @ corners.T
    slope = math.tan(math.radians(fovy) / 2) / _EDGE
    wide, tall = slope * aspect, slope
    # Every corner lies in the picture: |across - x| <= wide (z - back), |upward - y| <= tall (z - back).
    rightmost, leftmost = (across + wide * back).max(), (-across + wide * back).max()
    highest, lowest = (upward + tall * back).max(), (-upward + tall * back).max()
    distance = max((rightmost + leftmost) / (2 * wide), (highest + lowest) / (2 * tall))
    place = np.array([(rightmost - leftmost) / 2, (highest - lowest) / 2, distance]) @ axes
    camera = SubElement(world, "camera", name=name, pos=_numbers(place), fovy=_numbers([fovy]))
    camera.set("xyaxes", _numbers([*right, *up]))
    if name == "studio":
        light = {"directional": "true", "pos": "-2 -4 9", "dir": "0.35 0.40 -0.85"}
        shine = {"diffuse": "0.42 0.42 0.42", "specular": "0 0 0", "castshadow": "false"}
        SubElement(world, "light", {**light, **shine})


def _add_goals(
    world: Element, robots: Float[np.ndarray, "robots 2"], pose: Float[np.ndarray, " 3"]
) -> None:
    for i, (x, y) in enumerate(robots):
        look = {"type": "mesh", "mesh": "goal_ring", "rgba": _numbers([*accent(i), 1.0])}
        SubElement(world, "geom", {"name": f"goal_{i + 1}", "pos": _numbers([x, y, 0.0]), **look})
    frame = SubElement(
        world,
        "body",
        name="plank_goal",
        pos=_numbers([pose[0], pose[1], 0.0]),
        quat=_numbers([math.cos(pose[2] / 2), 0.0, 0.0, math.sin(pose[2] / 2)]),
    )
    for solid in plank_outline():
        _add_solid(frame, solid).set("rgba", _numbers([*solid.colour, 0.75]))


def _add_plank(world: Element) -> None:
    body = SubElement(world, "body", name=PLANK, mocap="true")
    size = PLANK_LENGTH / 2 + _FRINGE, PLANK_WIDTH / 2 + _FRINGE, 0.00125
    shadow = {"type": "box", "size": _numbers(size), "pos": _numbers([0.0, 0.0, size[2]])}
    SubElement(body, "geom", {"rgba": _numbers(_SHADOW), **shadow})
    for solid in plank():
        _add_solid(body, solid)


def _add_robot(world: Element, index: int) -> None:
    body = SubElement(world, "body", name=robot_name(index), mocap="true")
    shadow = {"type": "cylinder", "size": _numbers([1.12 * ROBOT_RADIUS, 0.0015])}
    place = _numbers([0.035, 0.03, 0.0025])
    SubElement(body, "geom", {"pos": place, "rgba": _numbers(_SHADOW), **shadow})
    for k, solid in enumerate(robot(accent(index))):
        _add_solid(body, solid, mesh=f"robot_mesh_{k + 1}")


def _add_meshes(assets: Element) -> None:
    """All robots have one shape; MJCF knows neither cut-off cones nor rings."""
    for k, solid in enumerate(robot(accent(0))):
        if solid.shape == "frustum":
            vertex = _numbers(frustum_corners(solid).ravel())
            SubElement(assets, "mesh", name=f"robot_mesh_{k + 1}", vertex=vertex)
    corners, faces = ring_mesh(0.95 * ROBOT_RADIUS, 1.4 * ROBOT_RADIUS, 0.002)
    triangles = " ".join(str(corner) for corner in faces.ravel())
    SubElement(assets, "mesh", name="goal_ring", vertex=_numbers(corners.ravel()), face=triangles)


def _add_solid(body: Element, solid: Solid, *, mesh: str = "") -> Element:
    geom = SubElement(body, "geom", pos=_numbers(solid.at), rgba=_numbers([*solid.colour, 1.0]))
    if solid.shape == "frustum":
        geom.attrib.update(type="mesh", mesh=mesh)
    else:
        geom.attrib.update(type=solid.shape, size=_numbers(solid.size))
    return geom


def _sin_cos(angle: float) -> tuple[float, float]:
    return math.sin(angle), math.cos(angle)


def _numbers(values: Iterable[float]) -> str:
    """Numbers of an attribute, rounded to 1e-5 (adding 0 turns -0 into 0)."""
    return " ".join(f"{round(float(v), 5) + 0.0:.5f}".rstrip("0").rstrip(".") for v in values)
