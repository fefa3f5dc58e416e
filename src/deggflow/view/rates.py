"""Success rates with their intervals: over team sizes, over families of requirements, as bars."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from deggflow.statistics import Rate

from .style import COLUMN, above, look, name_hollow, new_figure, whole_numbers

_FILLED = 0.82  # of a group's room, by its bars
_LIGHT = 0.4  # part of the colour that quoted bars have
_BARS_WIDTH = 5.4  # inches of a figure with bars


class RateSeries(NamedTuple):
    """Rates that are drawn alike.

    Attributes:
        label: In the legend.
        colour: Of its markers.
        rates: By team size or by name of a row.
        hollow: Somebody else's figures: open markers, not connected.
    """

    label: str
    colour: str
    rates: Mapping[int, Rate] | Mapping[str, Rate]
    hollow: bool = False


class SuccessBars(NamedTuple):
    """Success rates that are drawn alike, one for each group.

    Attributes:
        label: In the legend.
        colour: Of its bars.
        rates: One for each group.
        quoted: Somebody else's, drawn light and hatched.
    """

    label: str
    colour: str
    rates: Sequence[Rate]
    quoted: bool = False


@look()
def rates_over_size(series: Sequence[RateSeries], *, seen: int) -> Figure:
    """Success over the number of agents, with 95% Wilson intervals.

    Args:
        series: By number of agents.
        seen: Largest number of agents in the training data.
    """
    figure, (axes,) = new_figure(2.75)
    sizes = sorted({int(size) for each in series for size in each.rates})
    step = 0.45 / max(len(series), 1)  # of the markers beside each other
    for k, each in enumerate(series):
        shift = (k - (len(series) - 1) / 2) * step
        points = sorted((int(size), rate) for size, rate in each.rates.items())
        x = np.array([size + shift for size, _ in points])
        _draw(axes, each, x, [rate for _, rate in points], vertical=True)
    axes.axvspan(seen + 0.5, sizes[-1] + 0.6, color="#F1F1F1", zorder=0, linewidth=0)
    axes.text(
        (seen + 0.5 + sizes[-1] + 0.6) / 2, 105.5, "unseen in training", color="#6A6A6A",
        fontsize=7.5, ha="center", va="bottom",
    )  # fmt: skip
    axes.set(xlim=(sizes[0] - 0.6, sizes[-1] + 0.6), ylim=(0, 104))
    axes.set(xlabel="number of agents $N$", ylabel="success (%)")
    axes.grid(visible=False, axis="x")
    whole_numbers(axes, sizes)
    _legend(figure, axes, series)
    return figure


@look()
def rates_by_name(series: Sequence[RateSeries]) -> Figure:
    """Success of named rows, with 95% Wilson intervals."""
    names = list(dict.fromkeys(str(name) for each in series for name in each.rates))
    figure, (axes,) = new_figure(1.2 + 0.36 * len(names), width=COLUMN)
    step = 0.62 / max(len(series), 1)
    for k, each in enumerate(series):
        rates = {str(name): rate for name, rate in each.rates.items()}
        shift = (k - (len(series) - 1) / 2) * step
        places = np.array([names.index(name) + shift for name in rates])
        _draw(axes, each, places, list(rates.values()), vertical=False)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(0, 104), xlabel="success (%)")
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    _legend(figure, axes, series)
    return figure


@look()
def success_bars(
    groups: Sequence[str], bars: Sequence[SuccessBars], *, xlabel: str, ylabel: str
) -> Figure:
    """Success rates with their 95% Wilson intervals, a group of bars for each team size.

    Args:
        groups: What is written below each group.
        bars: Each has one rate for every group.
        xlabel: What the groups are.
        ylabel: What the rates are, in percent.

    Raises:
        ValueError: If the rates don't fit the groups.
    """
    for each in bars:
        if len(each.rates) != len(groups):
            raise ValueError(
                f"`bars` must hold one rate for each of {len(groups)} groups; "
                f"{each.label!r} has {len(each.rates)}."
            )
    figure, (axes,) = new_figure(2.7, width=_BARS_WIDTH)
    width = _FILLED / max(len(bars), 1)
    for k, each in enumerate(bars):
        x = np.arange(len(groups)) + (k - (len(bars) - 1) / 2) * width
        proportion, reach = _percentages(each.rates)
        colour = 1.0 - (_LIGHT if each.quoted else 1.0) * (1.0 - np.array(to_rgb(each.colour)))
        for bar in axes.bar(x, proportion, 0.9 * width, color=colour, label=each.label):
            bar.set(hatch="/////" if each.quoted else None, edgecolor="white", linewidth=0.0)
        axes.errorbar(x, proportion, reach, fmt="none", ecolor="#222222", elinewidth=0.8)
    axes.set_xticks(np.arange(len(groups)), groups)
    axes.tick_params(axis="x", length=0)
    axes.set(xlabel=xlabel, ylabel=ylabel, ylim=(0.0, 103.0))
    axes.grid(visible=False, axis="x")
    above(figure, axes, columns=max(len(bars), 1))
    return figure


def _legend(figure: Figure, axes: Axes, series: Sequence[RateSeries]) -> None:
    """One entry for each method, and one in grey for each other source."""
    for label in dict.fromkeys(each.label for each in series if each.hollow):
        name_hollow(axes, label)
    above(figure, axes, columns=2)


def _percentages(
    rates: Sequence[Rate],
) -> tuple[Float[np.ndarray, " rates"], Float[np.ndarray, "2 rates"]]:
    """Rates in percent, and how far their intervals reach below and above."""
    proportion = np.array([100 * rate.proportion for rate in rates])
    ends = 100 * np.array([rate.interval() for rate in rates]).reshape(-1, 2)
    # Rounding may put an interval's end a hair within the proportion.
    return proportion, np.maximum(np.stack([proportion - ends[:, 0], ends[:, 1] - proportion]), 0.0)


def _draw(
    axes: Axes, series: RateSeries, places: np.ndarray, rates: Sequence[Rate], *, vertical: bool
) -> None:
    proportion, reach = _percentages(rates)
    x, y = (places, proportion) if vertical else (proportion, places)
    errors: dict[str, Any] = {"yerr" if vertical else "xerr": reach}
    connected = vertical and not series.hollow
    axes.errorbar(
        x,
        y,
        **errors,
        label=None if series.hollow else series.label,
        color=series.colour,
        marker="o",
        linestyle="-" if connected else "none",
        elinewidth=0.9,
        capsize=1.6,
        capthick=0.9,
        markerfacecolor="white" if series.hollow else series.colour,
        markersize=3.6,
    )
