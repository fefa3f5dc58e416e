"""A factor below its time-varying upper bound while a sample is generated."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deggflow.files import StrPath

from .style import BOUND, GUIDED, NOMINAL, above, look, new_figure, save_figure

_SHADE = "#e9eef3"  # below a bound


class BoundPanel(NamedTuple):
    """A factor and its bound during one generation.

    Attributes:
        title: Above the axes.
        tau: Generative times.
        value: The factor q.
        bound: Its bound beta.
        shift: Taken off all curves, as the factor's value before the policy.
        nominal: q without guidance, from the same z(0).
    """

    title: str
    tau: Float[np.ndarray, " times"]
    value: Float[np.ndarray, " times"]
    bound: Float[np.ndarray, " times"]
    shift: float = 0.0
    nominal: Float[np.ndarray, " times"] | None = None


@look()
def draw_bounds(path: StrPath, panels: Sequence[BoundPanel], *, ylabel: str) -> None:
    """Writes `bounds_figure`.

    Args:
        path: The file; its ending decides: ".pdf", ".svg" or ".png".
        panels: One set of axes each, in a row.
        ylabel: Name of the factor; also in the legend.

    Raises:
        ValueError: If there is no panel, or one's arrays differ in length.
    """
    save_figure(path, bounds_figure(panels, name=ylabel))


@look()
def bounds_figure(panels: Sequence[BoundPanel], *, name: str, ylabel: str | None = None) -> Figure:
    """A factor q below its time-varying upper bound, as in the paper (fig:task1_task_sampling).

    Args:
        panels: One set of axes each, in a row.
        name: Of the factor, in the legend.
        ylabel: Of the axes; the factor's name if not given.

    Raises:
        ValueError: If there is no panel, or one's arrays differ in length.
    """
    _check_panels(panels)
    figure, row = new_figure(2.3, width=2.2 * len(panels) + 0.4, columns=len(panels))
    for axes, panel in zip(row, panels, strict=True):
        _draw_bound(axes, panel, name)
    row[0].set_ylabel(name if ylabel is None else ylabel)
    most = max(row, key=lambda axes: len(axes.lines))  # the fullest panel explains all
    above(figure, most, columns=len(most.lines))
    return figure


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
    value, bound = panel.value - panel.shift, panel.bound - panel.shift
    nominal = [] if panel.nominal is None else [panel.nominal - panel.shift]
    values = np.concatenate([value, bound, *nominal])
    values = values[np.isfinite(values)]
    low, high = (values.min(), values.max()) if values.size else (0.0, 1.0)
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
