"""Training and validation curves of several seeds: their mean and one sample standard deviation."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from .style import OTHERS, above, look, new_figure

SKIPPED = 0.04  # of the run: axes that fit its first losses would squeeze all others into a line


class Band(NamedTuple):
    """One loss of several seeds.

    Attributes:
        steps: Where all of them were evaluated.
        mean: Over seeds.
        deviation: Sample standard deviation over seeds; None of one seed.
    """

    steps: Int[np.ndarray, " points"]
    mean: Float[np.ndarray, " points"]
    deviation: Float[np.ndarray, " points"] | None


class CurvePanel(NamedTuple):
    """Both losses of one task.

    Attributes:
        title: Above the axes.
        training: The training loss.
        validation: The validation loss.
    """

    title: str
    training: Band
    validation: Band


def band_of(steps: Int[np.ndarray, " points"], losses: Float[np.ndarray, "seeds points"]) -> Band:
    """Mean and sample standard deviation over seeds."""
    deviation = losses.std(axis=0, ddof=1) if len(losses) > 1 else None
    return Band(steps, losses.mean(axis=0), deviation)


@look()
def draw_bands(panels: Sequence[CurvePanel], *, width: float) -> Figure:
    """Training and validation losses, one panel a task.

    Args:
        panels: Beside each other.
        width: Of the figure, inches.
    """
    figure, row = new_figure(2.5, width=width, columns=len(panels))
    for axes, panel in zip(row, panels, strict=True):
        ends = []
        for label, colour, band in (
            ("training", OTHERS[0], panel.training),
            ("validation", OTHERS[1], panel.validation),
        ):
            axes.plot(band.steps / 1000, band.mean, color=colour, label=label, linewidth=1.2)
            spread = np.zeros_like(band.mean) if band.deviation is None else band.deviation
            low, high = band.mean - spread, band.mean + spread
            if band.deviation is not None:
                axes.fill_between(
                    band.steps / 1000, low, high, color=colour, alpha=0.25, linewidth=0
                )
            later = band.steps >= SKIPPED * band.steps[-1]
            ends += [low[later].min(), high[later].max()]
        room = 0.05 * max(max(ends) - min(ends), 1e-6)
        axes.set(ylim=(min(ends) - room, max(ends) + room), xlim=(0, None), title=panel.title)
        axes.set_xlabel("training step (thousands)")
    row[0].set_ylabel("loss (per agent)")
    above(figure, row[0], columns=2)
    return figure
