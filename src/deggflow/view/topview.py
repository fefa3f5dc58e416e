"""Views from above, drawn by matplotlib: they need no OpenGL and can be saved as vector graphics."""

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from .solids import Solid, frustum_corners, rotation

ROUND = np.linspace(0.0, 2.0 * np.pi, 33)[
    :-1
]  # rad, corners of the polygon that stands for a circle
_DPI = 100  # dots per inch of figures turned into pixels
_BOTTOM = 0.48  # inches below the axes, for the labels

Polygon = Float[np.ndarray, "_ 2"]


def topview_axes(size: tuple[float, float], *, left: float, rest: float) -> tuple[Figure, Axes]:
    """A figure that belongs to no window, with one set of axes.

    Args:
        size: Width and height, inches.
        left: Beside the axes, for the labels, inches.
        rest: Above the axes and to the right, inches.
    """
    figure = Figure(figsize=size, dpi=_DPI)
    width, height = max(size[0] - left - rest, 0.1), max(size[1] - _BOTTOM - rest, 0.1)
    place = (left / size[0], _BOTTOM / size[1], width / size[0], height / size[1])
    return figure, figure.add_axes(place)


def set_extent(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Axes in metres, to scale, without a frame, that show what lies between the ends."""
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.tick_params(length=0, colors="#444444")
    axes.spines[:].set_visible(False)


def figure_size(width: int, height: int) -> tuple[float, float]:
    """Inches of a figure of so many pixels."""
    return width / _DPI, height / _DPI


def pixels(figure: Figure) -> UInt8[np.ndarray, "height width 3"]:
    """The figure as an array."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def placed(points: Polygon, pose: Float[np.ndarray, " 3"]) -> Polygon:
    """Points of a body frame in the world, for a body's pose (m, m, rad)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def silhouette(solid: Solid) -> Float[np.ndarray, "corners 2"]:
    """The solid's outline seen from above, as a polygon."""
    points = _surface(solid)[:, :2]
    return points[ConvexHull(points).vertices]


def _surface(solid: Solid) -> Float[np.ndarray, "points 3"]:
    """Points whose convex hull is the solid (up to the polygon that stands for a circle)."""
    circle = np.stack([np.cos(ROUND), np.sin(ROUND), np.zeros_like(ROUND)], axis=-1)
    tilts = np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None, None]
    up = np.array([0.0, 0.0, 1.0])
    sphere = (np.cos(tilts) * circle + np.sin(tilts) * up).reshape(-1, 3)
    match solid.shape:
        case "capsule":
            ends = np.array([solid.at, solid.to])
            return (ends[:, None] + solid.size[0] * sphere).reshape(-1, 3)
        case "cylinder":
            radius, half = solid.size
            local = np.concatenate([radius * circle - half * up, radius * circle + half * up])
        case "frustum":
            local = frustum_corners(solid)
        case "box":
            signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
            local = signs * solid.size
        case "ellipsoid":
            local = sphere * solid.size
    return local @ rotation(solid.turn).T + solid.at
