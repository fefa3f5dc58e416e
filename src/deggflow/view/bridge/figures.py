"""Figures for Task 1: the stages of a process, and success beside success."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import UInt8

from deggflow.statistics import Rate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FILLED = 0.82  # of a group's room, by its bars
_LIGHT = 0.4  # part of the colour that quoted bars have
_WIDTH = 5.4  # inches of a figure with bars
_TITLE, _GAP = 0.22, 0.08  # inches above a picture, and below it


class SuccessBars(NamedTuple):
    """Success rates that are drawn alike, one for each group."""

    label: str
    colour: str
    rates: Sequence[Rate]
    quoted: bool = False  # somebody else's, drawn light and hatched


def picture_column(
    images: Sequence[UInt8[np.ndarray, "height width 3"]],
    titles: Sequence[str],
    *,
    width: float = 5.0,
) -> Figure:
    """Pictures of one size below each other, each under its title, as in the paper (fig:task1_rollout).

    Args:
        images: The pictures.
        titles: One above each.
        width: Of the pictures, inches.

    Raises:
        ValueError: If there is none, or they differ in size.
    """
    sizes = {image.shape for image in images}
    if len(sizes) != 1:
        raise ValueError(f"`images` must be one or more of one size; got {sorted(sizes)}.")
    from matplotlib.figure import Figure

    from deggflow.view.style import look

    high, wide, _ = sizes.pop()
    height = width * high / wide
    pitch = _TITLE + height + _GAP
    total = len(images) * pitch
    with look():
        figure = Figure(figsize=(width + 2 * _GAP, total))
        for k, (image, title) in enumerate(zip(images, titles, strict=True)):
            bottom = total - k * pitch - _TITLE - height
            across = _GAP / (width + 2 * _GAP)
            axes = figure.add_axes((across, bottom / total, 1 - 2 * across, height / total))
            axes.imshow(image, aspect="auto")
            axes.set_title(title, pad=3)
            axes.set(xticks=[], yticks=[])
            axes.grid(visible=False)
            axes.spines[:].set(visible=True, color="#cdcdcd")
    return figure


def success_bars(groups: Sequence[str], bars: Sequence[SuccessBars]) -> Figure:
    """Success rates with their 95% Wilson intervals, a group of bars for each number of robots.

    Args:
        groups: What is written below each group.
        bars: Each has one rate for every group.

    Raises:
        ValueError: If the rates don't fit the groups.
    """
    for each in bars:
        if len(each.rates) != len(groups):
            raise ValueError(
                f"`bars` must hold one rate for each of {len(groups)} groups; "
                f"{each.label!r} has {len(each.rates)}."
            )
    from matplotlib.colors import to_rgb

    from deggflow.view.style import above, look, new_figure

    with look():
        figure, (axes,) = new_figure(2.7, width=_WIDTH)
        width = _FILLED / max(len(bars), 1)
        for k, each in enumerate(bars):
            x = np.arange(len(groups)) + (k - (len(bars) - 1) / 2) * width
            proportion = 100 * np.array([rate.proportion for rate in each.rates])
            ends = 100 * np.array([rate.interval() for rate in each.rates]).reshape(-1, 2)
            # Rounding may put an interval's end a hair within the proportion.
            reach = np.maximum(np.stack([proportion - ends[:, 0], ends[:, 1] - proportion]), 0.0)
            colour = 1.0 - (_LIGHT if each.quoted else 1.0) * (1.0 - np.array(to_rgb(each.colour)))
            for bar in axes.bar(x, proportion, 0.9 * width, color=colour, label=each.label):
                bar.set(hatch="/////" if each.quoted else None, edgecolor="white", linewidth=0.0)
            axes.errorbar(x, proportion, reach, fmt="none", ecolor="#222222", elinewidth=0.8)
        axes.set_xticks(np.arange(len(groups)), groups)
        axes.tick_params(axis="x", length=0)
        axes.set(xlabel="number of robots $N$", ylabel="trials that bridge the gap (%)")
        axes.set(ylim=(0.0, 103.0))
        axes.grid(visible=False, axis="x")
        above(figure, axes, columns=max(len(bars), 1))
    return figure
