"""The bridge drawn from above by matplotlib: what is shown where OpenGL is missing, and in plots."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle, Polygon, Rectangle

from deggflow.tasks.bridge import world
from deggflow.view.colours import ACCENTS, FAULT
from deggflow.view.outlines import placed
from deggflow.view.topview import figure_size, pixels, set_extent, topview_axes

from .moment import THICKNESS, Moment
from .parts import DARK_WOOD, LOST, WOOD

_GROUND, _GRID, _PIT, _BORDER = "#f4f2ec", "#e2dfd6", "#57524b", "#8f8878"
_MARGIN = 0.3  # m around the workspace


def topview_figure(
    moment: Moment,
    robot_goals: Float[np.ndarray, "robots 2"],
    plank_goal: Float[np.ndarray, " 3"],
    *,
    size: tuple[float, float] = (6.4, 3.6),
) -> Figure:
    """One moment from above as a matplotlib figure.

    Args:
        moment: Where everything stands and what is red.
        robot_goals: Of each robot, m.
        plank_goal: Pose (m, m, rad).
        size: Width and height, inches.

    Returns:
        A figure that belongs to no window; save it by `figure.savefig("bridge.pdf")`.
    """
    figure, axes = topview_axes(size, left=0.62, rest=0.10)
    axes.set_facecolor("none")
    draw_world(axes)
    draw_plank(axes, plank_goal, fill=False, edgecolor=WOOD, linewidth=1.2, linestyle=(0, (4, 2)))
    plank = (FAULT, "#7d1312") if moment.red_plank else (WOOD, DARK_WOOD)
    draw_plank(axes, moment.plank, facecolor=plank[0], edgecolor=plank[1], linewidth=1.0, zorder=3)
    for i, goal in enumerate(robot_goals):
        _draw_goal(axes, i, goal)
    for i, robot in enumerate(moment.robots):
        of_lost = LOST if moment.lost_robots[i] else ACCENTS[i % len(ACCENTS)]
        _draw_robot(axes, robot, FAULT if moment.red_robots[i] else of_lost)
    return figure


def topview_image(
    moment: Moment,
    robot_goals: Float[np.ndarray, "robots 2"],
    plank_goal: Float[np.ndarray, " 3"],
    width: int,
    height: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """One moment from above in pixels."""
    figure = topview_figure(moment, robot_goals, plank_goal, size=figure_size(width, height))
    return pixels(figure)


def draw_world(axes: Axes, *, pit: str = _PIT) -> None:
    """Both grounds, the gap and the workspace's border, with axes in metres."""
    corner, gap = (world.X_MIN, world.Y_MIN), world.GAP_RIGHT - world.GAP_LEFT
    width, depth = world.X_MAX - world.X_MIN, world.Y_MAX - world.Y_MIN
    low, height = world.Y_MIN - _MARGIN, depth + 2 * _MARGIN
    axes.add_patch(Rectangle(corner, width, depth, facecolor=_GROUND, zorder=0))
    for x in range(int(world.X_MIN) + 1, int(world.X_MAX) + 1):
        axes.plot([x, x], [world.Y_MIN, world.Y_MAX], color=_GRID, linewidth=0.6, zorder=0.2)
    for y in range(int(world.Y_MIN) + 1, int(world.Y_MAX)):
        axes.plot([world.X_MIN, world.X_MAX], [y, y], color=_GRID, linewidth=0.6, zorder=0.2)
    axes.add_patch(Rectangle(corner, width, depth, fill=False, edgecolor=_BORDER, zorder=0.4))
    axes.add_patch(Rectangle((world.GAP_LEFT, low), gap, height, facecolor=pit, zorder=0.6))
    set_extent(axes, (world.X_MIN - _MARGIN, world.X_MAX + _MARGIN), (low, low + height))


def draw_plank(axes: Axes, pose: Float[np.ndarray, " 3"], **style: Any) -> None:
    """The plank's rectangle, in matplotlib's style; what lies beyond the axes is drawn too."""
    half = np.array([world.PLANK_LENGTH, world.PLANK_WIDTH]) / 2
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    patch = {"closed": True, "clip_on": False, "zorder": 2, **style}
    axes.add_patch(Polygon(placed(corners, pose), **patch))


def _draw_goal(axes: Axes, index: int, goal: Float[np.ndarray, " 2"]) -> None:
    colour = ACCENTS[index % len(ACCENTS)]
    place = (float(goal[0]), float(goal[1]))
    axes.add_patch(
        Annulus(
            place, 1.4 * world.ROBOT_RADIUS, 0.45 * world.ROBOT_RADIUS, facecolor=colour, zorder=2.5
        )
    )


def _draw_robot(axes: Axes, robot: Float[np.ndarray, " 3"], colour: str) -> None:
    """A disk with a light deck; the rim is wide on the plank, and the disk faint in the pit."""
    x, y, z = (float(value) for value in robot)
    rim = 0.8 + 0.8 * max(z, 0.0) / THICKNESS
    disks = [
        Circle((x, y), world.ROBOT_RADIUS, facecolor=colour, edgecolor="#22252a", linewidth=rim),
        Circle((x, y), 0.62 * world.ROBOT_RADIUS, facecolor="#f7f6f2"),
        Circle((x, y), 0.36 * world.ROBOT_RADIUS, facecolor="#2b2f36"),
    ]
    for k, disk in enumerate(disks):
        disk.set(zorder=4 + 0.1 * k, clip_on=False, alpha=0.75 if z < 0.0 else 1.0)
        axes.add_patch(disk)
