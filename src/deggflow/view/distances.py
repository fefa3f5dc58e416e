"""How far guided samples lie from nominal ones: distances over their spread, and what a theorem promises."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import (
    BOUND,
    GUIDED,
    OTHERS,
    PAGE,
    above,
    look,
    name_hollow,
    new_figure,
    whole_numbers,
)

STATES, POSES = OTHERS[0], OTHERS[1]  # colours of the two metrics


class Measured(NamedTuple):
    """A ratio with its interval.

    Attributes:
        value: The ratio.
        low: Lower end of the interval.
        high: Upper end of the interval.
    """

    value: float
    low: float
    high: float


class RatioSeries(NamedTuple):
    """A ratio over the number of agents, ours and what the paper's text says of it.

    Attributes:
        label: In the legend.
        colour: Of markers and band.
        ours: By number of agents.
        points: The paper's, by number of agents.
        band: The paper's least and greatest, whatever the number of agents.
    """

    label: str
    colour: str
    ours: Mapping[int, Measured]
    points: Mapping[int, float]
    band: tuple[float, float] | None = None


class BoundLine(NamedTuple):
    """A distance over the number of agents.

    Attributes:
        label: In the legend.
        logs: Natural logarithms of the distance, by number of agents.
        promised: Whether it is a bound; else it is measured.
    """

    label: str
    logs: Mapping[int, float]
    promised: bool


@look()
def draw_ratios(panels: Sequence[tuple[str, Sequence[RatioSeries]]]) -> Figure:
    """Ratios in percent over the number of agents, one panel for each kind.

    Args:
        panels: Label of the y axis, and what is drawn there.
    """
    figure, row = new_figure(2.5, width=PAGE, columns=len(panels))
    for axes, (label, series) in zip(row, panels, strict=True):
        for k, each in enumerate(series):
            _draw_ratio(axes, each, 0.16 * (k - (len(series) - 1) / 2))
        axes.set(xlabel="number of agents $N$", ylabel=label)
        axes.grid(visible=False, axis="x")
        whole_numbers(axes, [size for each in series for size in (*each.ours, *each.points)])
    low, high = row[0].get_ylim()
    row[0].set_ylim(min(low, 0.0), high)
    name_hollow(row[0], "paper")
    above(figure, row[0], columns=3)
    return figure


def _draw_ratio(axes: Axes, series: RatioSeries, shift: float) -> None:
    sizes = sorted(series.ours)
    value, low, high = 100 * np.array([series.ours[size] for size in sizes]).T
    x = np.array(sizes) + shift
    reach = np.maximum([value - low, high - value], 0.0)
    axes.errorbar(
        x, value, yerr=reach, color=series.colour, marker="o", label=series.label,
        elinewidth=0.9, markersize=3.6,
    )  # fmt: skip
    if series.points:
        sizes = sorted(series.points)
        percentages = [100 * series.points[size] for size in sizes]
        axes.plot(
            np.array(sizes) + shift, percentages, "o", color=series.colour, markerfacecolor="white",
            markersize=4.2,
        )  # fmt: skip
    if series.band is not None:
        low, high = (100 * end for end in series.band)
        axes.axhspan(low, high, color=series.colour, alpha=0.16, linewidth=0, zorder=0)


@look()
def draw_bounds_over_size(lines: Sequence[BoundLine]) -> Figure:
    """Measured distances below what bounds them, over the number of agents, on a logarithmic axis."""
    figure, (axes,) = new_figure(2.9)
    styles = iter(("-", (0, (5, 2)), (0, (3, 1.5)), (0, (1, 1.2)), (0, (4, 1.5, 1, 1.5))))
    markers = iter("osD^vPX")
    for line in lines:
        sizes = sorted(line.logs)
        axes.plot(
            sizes,
            [line.logs[size] / np.log(10) for size in sizes],
            color=BOUND if line.promised else GUIDED,
            linestyle=next(styles) if line.promised else "-",
            marker=next(markers),
            markersize=3.4,
            linewidth=1.1,
            label=line.label,
        )
    axes.set(xlabel="number of agents $N$", ylabel=r"$\log_{10}$ of the distance in $\mathbf{z}$")
    axes.grid(visible=False, axis="x")
    whole_numbers(axes, [size for line in lines for size in line.logs])
    above(figure, axes, columns=2)
    return figure
