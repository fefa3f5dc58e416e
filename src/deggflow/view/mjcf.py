"""What the MJCF files of all tasks have in common; lengths in m, angles in rad."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from .solids import Point, Solid, frustum_corners

EDGE = 1.02  # how much larger than what they have to hold pictures of fitted cameras are


class Direction(NamedTuple):
    """Where a camera looks from.

    Attributes:
        elevation: Above the ground, rad; pi / 2 looks down.
        azimuth: From the front (0) to the right, rad.
        fovy: Vertical field of view, deg.
    """

    elevation: float
    azimuth: float
    fovy: float


class ModelFile(NamedTuple):
    """A model's root element and the children that are filled in.

    Attributes:
        root: The whole model.
        visual: How it is rendered.
        default: Attributes of all geoms, or of classes of geoms.
        assets: Meshes and textures.
        world: Bodies, geoms, cameras and lights.
    """

    root: Element
    visual: Element
    default: Element
    assets: Element
    world: Element


def new_model(
    name: str, *, extent: float, size: tuple[int, int], fovy: float, stacks: int
) -> ModelFile:
    """An empty model with a white backdrop and soft light from the camera.

    Args:
        name: Of the model.
        extent: Half the model's size, for MuJoCo's own camera.
        size: Largest width and height of pictures, pixels.
        fovy: Vertical field of view of MuJoCo's own camera, deg.
        stacks: Bands that round geoms are drawn in from bottom to top.
    """
    root = Element("mujoco", model=name)
    SubElement(root, "compiler", angle="radian", eulerseq="zyx")
    SubElement(root, "statistic", center="0 0 0", extent=numbers([extent]))
    visual = SubElement(root, "visual")
    buffer = {"offwidth": str(size[0]), "offheight": str(size[1])}
    SubElement(visual, "global", {**buffer, "fovy": numbers([fovy])})
    fine = {"numslices": "40", "numstacks": str(stacks), "numquads": "1"}
    SubElement(visual, "quality", {"offsamples": "4", "shadowsize": "0", **fine})
    soft = {"ambient": "0.46 0.46 0.46", "diffuse": "0.2 0.2 0.2", "specular": "0 0 0"}
    SubElement(visual, "headlight", soft)
    default = SubElement(root, "default")
    assets = SubElement(root, "asset")
    white = {"builtin": "flat", "rgb1": "1 1 1", "rgb2": "1 1 1", "width": "8", "height": "8"}
    SubElement(assets, "texture", {"name": "backdrop", "type": "skybox", **white})
    return ModelFile(root, visual, default, assets, SubElement(root, "worldbody"))


def add_light(world: Element, place: Point, *, specular: float) -> None:
    """Light from the upper left, which casts no shadows."""
    source = {"directional": "true", "pos": numbers(place), "dir": "0.35 0.40 -0.85"}
    shine = {"diffuse": "0.42 0.42 0.42", "specular": numbers([specular] * 3)}
    SubElement(world, "light", {**source, **shine, "castshadow": "false"})


def add_camera(
    world: Element,
    name: str,
    place: Iterable[float],
    right: Iterable[float],
    up: Iterable[float],
    fovy: float,
) -> None:
    """A camera by its place, the directions that its pictures have, and its field of view (deg)."""
    camera = SubElement(world, "camera", name=name, pos=numbers(place), fovy=numbers([fovy]))
    camera.set("xyaxes", numbers([*right, *up]))


def add_fitted_camera(
    world: Element, name: str, direction: Direction, low: Point, high: Point, aspect: float
) -> None:
    """A camera just so far away that its picture holds a box.

    Args:
        world: Which the camera belongs to.
        name: Of the camera.
        direction: From which it looks.
        low: Least coordinates of the box, m.
        high: Largest coordinates of the box, m.
        aspect: Width over height of the pictures.
    """
    se, sa = math.sin(direction.elevation), math.sin(direction.azimuth)
    ce, ca = math.cos(direction.elevation), math.cos(direction.azimuth)
    right, up = np.array([ca, sa, 0.0]), np.array([-sa * se, ca * se, ce])
    axes = np.stack([right, up, np.cross(right, up)])
    corners = np.array([[x, y, z] for x, y, z in np.ndindex(2, 2, 2)])
    across, upward, back = axes @ (corners * np.subtract(high, low) + low).T
    slope = math.tan(math.radians(direction.fovy) / 2) / EDGE
    wide, tall = slope * aspect, slope
    # Every corner lies in the picture: |across - x| <= wide (z - back), |upward - y| <= tall (z - back).
    rightmost, leftmost = (across + wide * back).max(), (-across + wide * back).max()
    highest, lowest = (upward + tall * back).max(), (-upward + tall * back).max()
    distance = max((rightmost + leftmost) / (2 * wide), (highest + lowest) / (2 * tall))
    place = np.array([(rightmost - leftmost) / 2, (highest - lowest) / 2, distance]) @ axes
    add_camera(world, name, place, right, up, direction.fovy)


def add_solid(
    body: Element, solid: Solid, *, mesh: str = "", coloured: bool = True, name: str | None = None
) -> Element:
    """A geom of the solid's shape.

    Args:
        body: Which the geom belongs to.
        solid: Placed in the body's frame.
        mesh: Of a frustum, the name under which `add_frustum_mesh` has put it.
        coloured: Whether the geom has the solid's colour; else its class decides.
        name: Of the geom, if it has one.
    """
    geom = SubElement(body, "geom", {"name": name} if name else {})
    if solid.shape == "frustum":
        geom.attrib.update(type="mesh", mesh=mesh)
    else:
        geom.attrib.update(type=solid.shape, size=numbers(solid.size))
    if solid.to is not None:
        geom.set("fromto", numbers([*solid.at, *solid.to]))
    else:
        geom.set("pos", numbers(solid.at))
    if any(solid.turn):
        geom.set("euler", numbers(solid.turn))
    if coloured:
        geom.set("rgba", numbers([*solid.colour, 1.0]))
    return geom


def add_frustum_meshes(assets: Element, owner: str, solids: Sequence[Solid]) -> None:
    """MJCF has no frustum: each is a mesh given by its corners, to which MuJoCo adds the faces."""
    for k, solid in enumerate(solids):
        if solid.shape == "frustum":
            vertex = numbers(frustum_corners(solid).ravel())
            SubElement(assets, "mesh", name=mesh_name(owner, k), vertex=vertex)


def mesh_name(owner: str, solid: int) -> str:
    """Name of the mesh of an owner's solid, counted from 0."""
    return f"{owner}_mesh_{solid + 1}"


def yaw_quaternion(theta: float) -> tuple[float, float, float, float]:
    """The quaternion of a turn by `theta` about the vertical."""
    return math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)


def numbers(values: Iterable[float]) -> str:
    """Numbers of an attribute, rounded to 1e-5 (adding 0 turns -0 into 0)."""
    return " ".join(f"{round(float(v), 5) + 0.0:.5f}".rstrip("0").rstrip(".") for v in values)


def model_text(model: ModelFile) -> str:
    """The model as indented text."""
    indent(model.root)
    return tostring(model.root, encoding="unicode") + "\n"
