"""Views from above, drawn by matplotlib: they need no OpenGL and can be saved as vector graphics."""

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_DPI = 100  # dots per inch of figures turned into pixels
_BOTTOM = 0.48  # inches below the axes, for the labels


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
