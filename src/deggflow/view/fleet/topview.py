"""A floor from above: obstacles, paths coloured by time, and robots at a moment."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import withStroke

from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.style import look

MAP = "viridis"  # colours of time
OBSTACLE, FAULT = "#8c8c8c", "#B00020"
INCHES = 5.0
_DPI = 150
_FINE = 8  # pieces of a step, for the colours of a path


def floor_axes(floor: FloorMap) -> tuple[Figure, Axes]:
    """A figure that belongs to no window, with bounds and obstacles drawn to scale."""
    left, low, right, high = floor.bounds
    figure = Figure(figsize=(INCHES, INCHES + 0.4), dpi=_DPI, layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(True)
    shapes: list[Any] = [Rectangle((x - w / 2, y - h / 2), w, h) for x, y, w, h in floor.boxes]
    shapes += [Circle((x, y), r) for x, y, r in floor.discs]
    shapes += [Polygon(corners) for corners in floor.polygons]
    axes.add_collection(PatchCollection(shapes, facecolor=OBSTACLE, edgecolor="none"))
    return figure, axes


def plan_axes(plan: Plan) -> tuple[Figure, Axes]:
    """As `floor_axes`; where robots leave the bounds, these are a frame within the picture."""
    figure, axes = floor_axes(plan.condition.floor)
    low, high = np.reshape(plan.condition.floor.bounds, (2, 2))
    places = np.concatenate(
        [plan.paths.reshape(-1, 2), plan.condition.starts, plan.condition.goals]
    )
    least, most = (extreme(places, axis=0) for extreme in (np.min, np.max))
    if (least < low).any() or (most > high).any():
        (x, y), (width, height) = low.tolist(), (high - low).tolist()
        frame = Rectangle((x, y), width, height, fill=False, edgecolor=OBSTACLE, linewidth=0.8)
        axes.add_patch(frame)
        room = 2 * plan.condition.radius
        least, most = np.minimum(low, least - room), np.maximum(high, most + room)
        axes.set(xlim=(least[0], most[0]), ylim=(least[1], most[1]))
    return figure, axes


def draw_paths(axes: Axes, paths: Float[np.ndarray, "robots 64 2"]) -> None:
    """Paths coloured by time, from dark at the start to light at the goal."""
    waypoints = paths.shape[1]
    time = np.linspace(0, waypoints - 1, _FINE * (waypoints - 1) + 1)
    for path in paths:
        fine = np.stack(
            [np.interp(time, np.arange(waypoints), path[:, k]) for k in (0, 1)], axis=-1
        )
        pieces: Any = np.stack([fine[:-1], fine[1:]], axis=1)
        lines = LineCollection(pieces, array=time[1:] / time[-1], cmap=MAP)
        lines.set(linewidth=1.6, capstyle="round")
        axes.add_collection(lines)


def draw_ends(axes: Axes, plan: Plan) -> None:
    """Starts as rings around the robots' numbers, goals as crosses with the numbers beside them, in italics.

    Rings and crosses of robots that miss a requirement are red.
    """
    condition, blocked = plan.condition, plan.verdict().blocked
    for number, (start, goal) in enumerate(zip(condition.starts, condition.goals, strict=True), 1):
        colour, width = (FAULT, 1.6) if number - 1 in blocked else ("#333333", 0.8)
        ring = Circle(start, condition.radius, fill=False, edgecolor=colour, linewidth=width)
        axes.add_patch(ring)
        axes.plot(*goal, "x", color=colour, markersize=4, markeredgewidth=width + 0.1)
        x, y = start
        at_start = axes.text(x, y, str(number), fontsize=6, ha="center", va="center")
        # A start may be where another robot's goal is: two numbers that do not cover each other.
        x, y = goal + 0.7 * condition.radius
        at_goal = axes.text(x, y, str(number), fontsize=5, style="italic", color="#555555")
        for label in (at_start, at_goal):
            label.set(zorder=5, path_effects=[withStroke(linewidth=2.0, foreground="white")])


def robot_patches(axes: Axes, plan: Plan) -> list[Circle]:
    """Discs of all robots; those that miss a requirement are red."""
    blocked = plan.verdict().blocked
    discs = []
    for robot, start in enumerate(plan.paths[:, 0]):
        colour = FAULT if robot in blocked else "#0072B2"
        disc = Circle(start, plan.condition.radius, facecolor=colour, alpha=0.85, zorder=4)
        axes.add_patch(disc)
        discs.append(disc)
    return discs


def pixels(figure: Figure) -> UInt8[np.ndarray, "rows columns 3"]:
    """The figure as an array."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def plan_figure(plan: Plan) -> Figure:
    """A plan's paths, and below them what its verdict says."""
    with look():
        figure, axes = plan_axes(plan)
        draw_paths(axes, plan.paths)
        draw_ends(axes, plan)
        verdict = plan.verdict()
        text = verdict.reason() or f"all requirements hold, {verdict.min_margin:.3g} to spare"
        colour = "#333333" if verdict.satisfied else FAULT
        axes.set_xlabel(text, color=colour, fontsize=7, wrap=True)
    return figure


class MovingRobots:
    """A plan's paths with its robots as discs that can be moved; those that miss a requirement are red."""

    def __init__(self, plan: Plan, size: tuple[int, int] | None = None) -> None:
        """Draws all that does not move.

        Args:
            plan: Whose robots move.
            size: Width and height in pixels, if not those of a picture of a plan.
        """
        with look():
            self._figure, axes = plan_axes(plan)
            if size is not None:
                self._figure.set_size_inches(size[0] / _DPI, size[1] / _DPI)
            draw_paths(axes, plan.paths)
            draw_ends(axes, plan)
            self._discs = robot_patches(axes, plan)

    def picture(self, places: Float[np.ndarray, "robots 2"]) -> UInt8[np.ndarray, "rows columns 3"]:
        """With the robots' centres at some places, in map units."""
        for disc, place in zip(self._discs, places, strict=True):
            disc.set_center((float(place[0]), float(place[1])))
        with look():
            return pixels(self._figure)
