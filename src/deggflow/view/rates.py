"""Success rates with their intervals, over team sizes and over families of requirements."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deggflow.statistics import Rate

from .style import COLUMN, above, look, name_hollow, new_figure, whole_numbers


class RateSeries(NamedTuple):
    """Rates that are drawn alike, by team size or by name of a row."""

    label: str
    colour: str
    rates: Mapping[int, Rate] | Mapping[str, Rate]
    hollow: bool = False  # somebody else's figures: open markers, not connected


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
        ordered = sorted((int(size), rate) for size, rate in each.rates.items())
        x = np.array([size + shift for size, _ in ordered])
        _draw(axes, each, x, [rate for _, rate in ordered], vertical=True)
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
        known = {str(name): rate for name, rate in each.rates.items()}
        shift = (k - (len(series) - 1) / 2) * step
        places = np.array([names.index(name) + shift for name in known])
        _draw(axes, each, places, list(known.values()), vertical=False)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(0, 104), xlabel="success (%)")
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    _legend(figure, axes, series)
    return figure


def _legend(figure: Figure, axes: Axes, series: Sequence[RateSeries]) -> None:
    """One entry for each method, and one in grey for each other source."""
    for label in dict.fromkeys(each.label for each in series if each.hollow):
        name_hollow(axes, label)
    above(figure, axes, columns=2)


def _draw(
    axes: Axes, series: RateSeries, places: np.ndarray, rates: Sequence[Rate], *, vertical: bool
) -> None:
    proportion = np.array([100 * rate.proportion for rate in rates])
    ends = 100 * np.array([rate.interval() for rate in rates]).reshape(-1, 2)
    # Rounding may put an interval's end a hair within the proportion.
    reach = np.maximum(np.stack([proportion - ends[:, 0], ends[:, 1] - proportion]), 0.0)
    x, y = (places, proportion) if vertical else (proportion, places)
    connected = vertical and not series.hollow
    axes.errorbar(
        x,
        y,
        **{"yerr" if vertical else "xerr": reach},
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
