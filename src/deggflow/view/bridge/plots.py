"""Plots for Task 1: a factor below its bound, and the ways that planks take."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.files import write_atomically
from deggflow.tasks.bridge.world import GAP_LEFT, GAP_RIGHT, Y_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, VERMILION = "#0072B2", "#D55E00"  # Okabe and Ito (2008)
_SHADE = "#f7e3d6"
_GAP = "#cbc6bc"  # light, as lines cross it
_DPI = 200  # of PNG files


class BoundPanel(NamedTuple):
    """A factor and its bound during one generation."""

    title: str
    tau: Float[np.ndarray, " times"]
    value: Float[np.ndarray, " times"]  # q
    bound: Float[np.ndarray, " times"]  # beta
    shift: float = 0.0  # taken off both curves, as the factor's value before the policy


class PathGroup(NamedTuple):
    """Ways of the plank's centre that are drawn alike."""

    label: str
    colour: str
    paths: Sequence[Float[np.ndarray, "_ 2"]]  # m


def draw_bounds(
    path: Path | str,
    panels: Sequence[BoundPanel],
    *,
    ylabel: str = r"$q_\mathrm{task}$",
) -> None:
    """Draws q below its time-varying upper bound, as in the paper (fig:task1_task_sampling).

    Args:
        path: The file; its ending decides: ".pdf", ".svg" or ".png".
        panels: One set of axes each, in a row.
        ylabel: Name of the factor; also in the legend.

    Raises:
        ValueError: If there is no panel, or one's arrays differ in length.
    """
    _check_panels(panels)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.5 * len(panels) + 0.4, 2.5), layout="constrained")
    row = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, panel in zip(row, panels, strict=True):
        _draw_bound(axes, panel, ylabel)
    row[0].set_ylabel(ylabel)
    entries = row[0].get_legend_handles_labels()
    figure.legend(*entries, frameon=False, fontsize=9, loc="outside upper center", ncols=2)
    _save(figure, Path(path))


def draw_paths(path: Path | str, groups: Sequence[PathGroup]) -> None:
    """Draws the ways of plank centres from above, over workspace and gap.

    Args:
        path: The file; its ending decides: ".pdf", ".svg" or ".png".
        groups: Each has its colour and its entry in the legend.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    from .topview import draw_world

    figure = Figure(figsize=(6.4, 3.4), layout="compressed")
    axes = figure.subplots()
    draw_world(axes, pit=_GAP)
    axes.text(
        (GAP_LEFT + GAP_RIGHT) / 2, Y_MIN + 0.2, "gap", color="#57524b", fontsize=9, ha="center"
    )
    for group in groups:
        alpha = float(np.clip(6.0 / max(len(group.paths), 1), 0.15, 0.9))
        lines = LineCollection(
            group.paths, colors=group.colour, alpha=alpha, linewidths=0.9, zorder=3
        )
        axes.add_collection(lines, autolim=False)
        ends = np.array([way[-1] for way in group.paths if len(way)]).reshape(-1, 2)
        axes.scatter(*ends.T, s=5, color=group.colour, alpha=min(2 * alpha, 1.0), lw=0, zorder=3.5)
        count = len(group.paths)
        axes.plot([], [], color=group.colour, linewidth=2.0, label=f"{group.label} ({count})")
    if groups:
        figure.legend(frameon=False, fontsize=9, loc="outside upper center", ncols=len(groups))
    _save(figure, Path(path))


def _check_panels(panels: Sequence[BoundPanel]) -> None:
    if len(panels) == 0:
        raise ValueError("`panels` must have at least one panel; got none.")
    for panel in panels:
        lengths = len(panel.tau), len(panel.value), len(panel.bound)
        if len(set(lengths)) > 1:
            raise ValueError(
                f"`tau`, `value` and `bound` of panel {panel.title!r} must be of the same length; "
                f"got {lengths}."
            )


def _draw_bound(axes: Axes, panel: BoundPanel, name: str) -> None:
    value, bound = panel.value - panel.shift, panel.bound - panel.shift
    finite = np.concatenate([value, bound])
    finite = finite[np.isfinite(finite)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    room = 0.06 * max(high - low, 1e-6)
    axes.fill_between(panel.tau, low - room, bound, color=_SHADE, linewidth=0.0, zorder=0)
    axes.plot(panel.tau, bound, color=VERMILION, linestyle="--", label=_bound_name(name))
    axes.plot(panel.tau, value, color=BLUE, label=name)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(low - room, high + room)
    axes.set_xlabel(r"$\tau$")
    axes.set_title(panel.title, fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)


def _bound_name(name: str) -> str:
    """The bound's symbol has the factor's index."""
    return name.replace("q", r"\beta", 1) if name.startswith("$q") else "bound"


def _save(figure: Figure, path: Path) -> None:
    buffer = BytesIO()
    kind = path.suffix.lstrip(".").lower()
    dated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dated.get(kind))
    write_atomically(path, buffer.getvalue())
