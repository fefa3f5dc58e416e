"""The scene from above, drawn by matplotlib: needs no OpenGL, can be saved as vector graphics."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from deggflow.tasks.tabletop.condition import Balance, SceneCondition
from deggflow.tasks.tabletop.library import type_name
from deggflow.tasks.tabletop.verdict import Verdict, judge
from deggflow.view.colours import FAULT
from deggflow.view.outlines import Polygon, placed
from deggflow.view.topview import figure_size, pixels, set_extent, topview_axes

from .marks import Marks, centre_of_mass, checked_poses, discs_of, marks_of
from .outlines import footprints, silhouettes

# Bluish green and vermilion differ for colour-blind readers too (Okabe and Ito, 2008); hatching and
# dashes tell them apart in print without colour.
FREE, BLOCKED, BALANCE = "#009e73", "#d55e00", "#0072b2"
_MARGIN = 0.06  # m around the table
_LABELLED = 24  # objects up to which each has its name written below it
_THIN = 0.4  # of the line width where there are more


def topview_figure(
    condition: SceneCondition,
    poses: Float[np.ndarray, "agents 3"],
    verdict: Verdict | None = None,
    *,
    size: tuple[float, float] = (6.0, 4.5),
) -> Figure:
    """The scene from above as a matplotlib figure.

    Args:
        condition: Objects, requirements and table.
        poses: x, y (m) and theta (rad) of each object.
        verdict: Decides what is red; exact geometry is asked if it is not given.
        size: Width and height, inches.

    Returns:
        A figure that belongs to no window; save it by `figure.savefig("scene.pdf")`.
    """
    rows = checked_poses(condition, poses)
    verdict = judge([condition], [rows])[0] if verdict is None else verdict
    figure, axes = topview_axes(size, left=0.70, rest=0.08)
    _draw_table(axes, condition)
    marks, few = marks_of(verdict), len(condition.objects) <= _LABELLED
    thick = 1.0 if few else _THIN
    for i, name in enumerate(condition.objects):
        _draw_regions(axes, condition, i, name, rows[i], marks, thick)
    for i, name in enumerate(condition.objects):
        _draw_object(axes, type_name(name), rows[i], i in marks.outlined, thick)
        if few:
            _write_name(axes, name, rows[i])
    if condition.balance is not None:
        _draw_balance(axes, condition.balance, centre_of_mass(condition, rows), marks.unbalanced)
    return figure


def topview_image(
    condition: SceneCondition,
    poses: Float[np.ndarray, "agents 3"],
    verdict: Verdict | None,
    width: int,
    height: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """The scene from above in pixels."""
    return pixels(topview_figure(condition, poses, verdict, size=figure_size(width, height)))


def _draw_table(axes: Axes, condition: SceneCondition) -> None:
    half_x, half_y = condition.width / 2, condition.depth / 2
    corners = np.array([[-half_x, -half_y], [half_x, -half_y], [half_x, half_y], [-half_x, half_y]])
    _draw(axes, [corners], 0.0, facecolors="#f6f2ea", edgecolors="#8c8172", linewidths=1.2)
    reach_x, reach_y = half_x + _MARGIN, half_y + _MARGIN
    set_extent(axes, (-reach_x, reach_x), (-reach_y, reach_y))


def _draw_regions(
    axes: Axes,
    condition: SceneCondition,
    owner: int,
    name: str,
    pose: Float[np.ndarray, " 3"],
    marks: Marks,
    thick: float,
) -> None:
    for k, disc in enumerate(discs_of(condition, name)):
        centre = tuple(placed(np.array([[disc.x, disc.y]]), pose)[0])
        blocked = (owner, k) in marks.blocked
        colour = BLOCKED if blocked else FREE
        fill = Circle(centre, disc.radius, facecolor=colour, alpha=0.22, zorder=1)
        edge = Circle(
            centre, disc.radius, fill=False, edgecolor=colour, linewidth=1.4 * thick, zorder=1.5
        )
        if blocked:
            edge.set(linestyle=(0, (3, 1.6)), hatch="////")
        for patch in (fill, edge):
            patch.set_clip_on(False)
            axes.add_patch(patch)


def _draw_balance(
    axes: Axes, balance: Balance, centre: Float[np.ndarray, " 2"], unbalanced: bool
) -> None:
    """The circle for the centre of mass, and a cross where it lies."""
    colour = BLOCKED if unbalanced else BALANCE
    style = (0, (3, 1.6)) if unbalanced else "solid"
    circle = Circle(
        (balance.x, balance.y), balance.radius, fill=False, edgecolor=colour, zorder=4.5
    )
    circle.set(linewidth=1.6, linestyle=style, clip_on=False)
    axes.add_patch(circle)
    axes.plot(
        *centre,
        marker="+",
        color=colour,
        markersize=9,
        markeredgewidth=2.0,
        zorder=4.6,
        clip_on=False,
    )


def _draw_object(
    axes: Axes, name: str, pose: Float[np.ndarray, " 3"], outlined: bool, thick: float
) -> None:
    outlines = [placed(part, pose) for part in footprints(name)]
    if outlined:
        _draw(axes, outlines, 2.0, facecolors="none", edgecolors=FAULT, linewidths=6.0 * thick)
    _draw(axes, outlines, 2.1, facecolors="#ddd5c6", edgecolors="#6b6257", linewidths=0.8 * thick)
    parts = [placed(part, pose) for part, _ in silhouettes(name)]
    colours = [colour for _, colour in silhouettes(name)]
    _draw(axes, parts, 2.2, facecolors=colours, edgecolors="face", linewidths=0.2)


def _write_name(axes: Axes, name: str, pose: Float[np.ndarray, " 3"]) -> None:
    outlines = [placed(part, pose) for part in footprints(type_name(name))]
    label = axes.text(
        float(pose[0]),
        min(float(part[:, 1].min()) for part in outlines) - 0.004,
        name.replace("_", " "),
        ha="center",
        va="top",
        fontsize=7,
        zorder=4,
    )
    label.set_path_effects([withStroke(linewidth=2, foreground="white")])


def _draw(axes: Axes, polygons: list[Polygon], zorder: float, **style: Any) -> None:
    """Polygons in matplotlib's `style`; what lies beyond the axes is drawn too."""
    axes.add_collection(PolyCollection(polygons, zorder=zorder, clip_on=False, **style))
