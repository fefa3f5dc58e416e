"""Failures against deviation, of many guidance methods."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deggflow.statistics import Rate

from .style import PAGE, look, new_figure

FLOOR = 0.1  # %, where a method without a failure is drawn

_MARGIN = 0.03  # of the distance axis, so that marks at 0 are whole


class FrontierPoint(NamedTuple):
    """One setting of a method's hyperparameters.

    Attributes:
        rate: Of success.
        transport: W2 to the nominal samples.
        chosen: Whether tables show this setting.
    """

    rate: Rate
    transport: float
    chosen: bool


class FrontierSeries(NamedTuple):
    """One method.

    Attributes:
        label: In the legend.
        colour: Of its markers.
        marker: Matplotlib's code of their shape.
        points: In the order of the hyperparameters.
        joined: Whether a line joins the points: there is but one hyperparameter.
    """

    label: str
    colour: str
    marker: str
    points: Sequence[FrontierPoint]
    joined: bool


@look()
def frontier(panels: Sequence[tuple[str, Sequence[FrontierSeries]]], *, unit: str) -> Figure:
    """Share of failures over the distance from nominal; the best methods are at the lower left.

    Args:
        panels: Title and methods of each set of axes.
        unit: Of the distance.
    """
    figure, row = new_figure(3.6, width=PAGE, columns=len(panels), sharey=True)
    for axes, (title, series) in zip(row, panels, strict=True):
        for each in series:
            _draw(axes, each)
        axes.set(yscale="log", ylim=(FLOOR / 1.5, 130), title=title)
        right = axes.get_xlim()[1]
        axes.set_xlim(-_MARGIN * right, right)
        axes.set_xlabel(f"$W_2$ to nominal ({unit})")
        axes.set_yticks([FLOOR, 1, 10, 100], ["none", "1", "10", "100"])
    row[0].set_ylabel("failed (%)")
    handles, labels = max(
        (axes.get_legend_handles_labels() for axes in row), key=lambda e: len(e[0])
    )
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def _draw(axes: Axes, series: FrontierSeries) -> None:
    x = [point.transport for point in series.points]
    y = [max(100 * (1 - point.rate.proportion), FLOOR) for point in series.points]
    line = "-" if series.joined else "none"
    axes.plot(x, y, color=series.colour, linestyle=line, linewidth=0.9, alpha=0.7, zorder=2)
    for k, point in enumerate(series.points):
        low, high = point.rate.interval()
        ends = [max(100 * (1 - end), FLOOR) for end in (high, low)]
        axes.plot([x[k]] * 2, ends, color=series.colour, linewidth=0.6, alpha=0.35, zorder=1)
        face = series.colour if point.chosen else "white"
        axes.plot(
            x[k], y[k], series.marker, color=series.colour, markerfacecolor=face, markersize=4.5, zorder=3
        )  # fmt: skip
    axes.plot([], [], series.marker, color=series.colour, label=series.label, linestyle=line)
