"""Where methods stand between a lower bound on any method's deviation and upper bounds on their own."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from .style import BOUND, GREY, PAGE, look, new_figure

_TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_ROW = 0.19  # inches of a method's row
_REST = 1.15  # inches of titles and axes


class Standing(NamedTuple):
    """One method.

    Attributes:
        label: Beside its row.
        colour: Of its marker.
        deviation: RMS distance to the nominal samples; None if every sample diverged.
        upper: Upper bound on it; None if there is none.
        complete: Whether every sample satisfies the requirements, so that the lower bound applies.
    """

    label: str
    colour: str
    deviation: float | None
    upper: float | None
    complete: bool


class StandingPanel(NamedTuple):
    """The methods at one number of agents.

    Attributes:
        title: Above the axes.
        lower: No method that always succeeds is closer to nominal.
        nearest: Samples as close as this exist.
        methods: From top to bottom, the same in all panels.
    """

    title: str
    lower: float
    nearest: float
    methods: Sequence[Standing]


@look()
def draw_standing(panels: Sequence[StandingPanel], *, unit: str) -> Figure:
    """One row for each method and one panel for each number of agents, on logarithmic axes.

    Args:
        panels: The panels.
        unit: Of the deviation.
    """
    rows = len(panels[0].methods)
    figure, axes = new_figure(_REST + _ROW * rows, width=PAGE, columns=len(panels), sharey=True)
    for one, panel in zip(axes, panels, strict=True):
        _draw(one, panel)
        one.set_xlabel(f"RMS deviation ({unit})")
    axes[0].set_yticks(range(rows), [method.label for method in panels[0].methods])
    axes[0].set_ylim(rows - 0.4, -0.6)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure


def _draw(axes: Axes, panel: StandingPanel) -> None:
    axes.axvspan(1e-9, panel.lower, color=GREY, alpha=0.28, linewidth=0, label="impossible")
    axes.axvspan(panel.lower, panel.nearest, color=GREY, alpha=0.12, linewidth=0, label="not known")
    points = [panel.lower, panel.nearest]
    for row, method in enumerate(panel.methods):
        if method.deviation is None or method.deviation <= 0:
            continue
        points.append(method.deviation)
        if method.upper is not None:
            points.append(method.upper)
            axes.plot([method.deviation, method.upper], [row] * 2, color=BOUND, linewidth=0.7)
            axes.plot(method.upper, row, "|", color=BOUND, markersize=5.5)
        face = method.colour if method.complete else "white"
        axes.plot(
            method.deviation, row, "o", color=method.colour, markerfacecolor=face, markersize=4.2
        )
    for label, face in (("every sample satisfies", BOUND), ("some samples fail", "white")):
        axes.plot([], [], "o", color=BOUND, markerfacecolor=face, markersize=4.2, label=label)
    axes.plot([], [], "|", color=BOUND, markersize=5.5, label="upper bound")
    axes.set(xscale="log", xlim=(panel.lower / 1.5, max(points) * 1.3), title=panel.title)
    axes.xaxis.set_major_locator(FixedLocator(_TICKS))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=False, axis="y")
