"""Plots for Task 1: a factor below its bound, and the ways that planks take."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.files import StrPath, write_atomically
from deggflow.tasks.bridge.world import GAP_LEFT, GAP_RIGHT, Y_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHADE = "#e9eef3"  # below a bound
_GAP = "#cbc6bc"  # light, as lines cross it
_DPI = 200  # of PNG files


class BoundPanel(NamedTuple):
    """A factor and its bound during one generation."""

    title: str
    tau: Float[np.ndarray, " times"]
    value: Float[np.ndarray, " times"]  # q
    bound: Float[np.ndarray, " times"]  # beta
    shift: float = 0.0  # taken off all curves, as the factor's value before the policy
    nominal: Float[np.ndarray, " times"] | None = None  # q without guidance, from the same z(0)


class PathGroup(NamedTuple):
    """Ways of the plank's centre that are drawn alike."""

    label: str
    colour: str
    paths: Sequence[Float[np.ndarray, "_ 2"]]  # m


def draw_bounds(
    path: StrPath,
    panels: Sequence[BoundPanel],
    *,
    ylabel: str = r"$q_\mathrm{task}$",
) -> None:
    """Writes `bounds_figure`.

    Args:
        path: The file; its ending decides: ".pdf", ".svg" or ".png".
        panels: One set of axes each, in a row.
        ylabel: Name of the factor; also in the legend.

    Raises:
        ValueError: If there is no panel, or one's arrays differ in length.
    """
    from deggflow.view.style import look

    with look():
        _save(bounds_figure(panels, name=ylabel), Path(path))


def bounds_figure(
    panels: Sequence[BoundPanel],
    *,
    name: str = r"$q_\mathrm{task}$",
    ylabel: str | None = None,
) -> Figure:
    """A factor q below its time-varying upper bound, as in the paper (fig:task1_task_sampling).

    Args:
        panels: One set of axes each, in a row.
        name: Of the factor, in the legend.
        ylabel: Of the axes; the factor's name if not given.

    Raises:
        ValueError: If there is no panel, or one's arrays differ in length.
    """
    _check_panels(panels)
    from deggflow.view.style import above, look, new_figure

    with look():
        figure, row = new_figure(2.3, width=2.2 * len(panels) + 0.4, columns=len(panels))
        for axes, panel in zip(row, panels, strict=True):
            _draw_bound(axes, panel, name)
        row[0].set_ylabel(name if ylabel is None else ylabel)
        most = max(row, key=lambda axes: len(axes.lines))  # the fullest panel explains all
        above(figure, most, columns=len(most.lines))
    return figure


def draw_paths(path: StrPath, groups: Sequence[PathGroup]) -> None:
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
        curves = [panel.tau, panel.value, panel.bound]
        curves += [] if panel.nominal is None else [panel.nominal]
        lengths = [len(curve) for curve in curves]
        if len(set(lengths)) > 1:
            raise ValueError(
                f"`tau`, `value`, `bound` and, if given, `nominal` of panel {panel.title!r} must be of the "
                f"same length; got {lengths}."
            )


def _draw_bound(axes: Axes, panel: BoundPanel, name: str) -> None:
    from deggflow.view.style import BOUND, GUIDED, NOMINAL

    value, bound = panel.value - panel.shift, panel.bound - panel.shift
    nominal = [] if panel.nominal is None else [panel.nominal - panel.shift]
    finite = np.concatenate([value, bound, *nominal])
    finite = finite[np.isfinite(finite)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    room = 0.06 * max(high - low, 1e-6)
    axes.fill_between(panel.tau, low - room, bound, color=_SHADE, linewidth=0.0, zorder=0)
    axes.plot(panel.tau, bound, color=BOUND, linestyle="--", label=_bound_name(name))
    axes.plot(panel.tau, value, color=GUIDED, label=f"{name}, guided" if nominal else name)
    for each in nominal:
        axes.plot(panel.tau, each, color=NOMINAL, label=f"{name}, nominal")
    axes.set(xlim=(0.0, 1.0), ylim=(low - room, high + room), title=panel.title)
    axes.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    axes.set_xlabel(r"generative time $\tau$")


def _bound_name(name: str) -> str:
    """The bound's symbol has the factor's index."""
    return name.replace("q", r"\beta", 1) if name.startswith("$q") else "bound"


def _save(figure: Figure, path: Path) -> None:
    buffer = BytesIO()
    kind = path.suffix.lstrip(".").lower()
    dated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dated.get(kind))
    write_atomically(path, buffer.getvalue())
