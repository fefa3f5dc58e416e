"""V while a scene is generated: nominal and guided, and the bound that the theorem promises."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from .style import BOUND, GREY, GUIDED, NOMINAL, above, look, new_figure

LEAST = 1e-6  # m^2, lower end of the axis; V comes to zero, which no logarithm shows


class ViolationCurves(NamedTuple):
    """V along two generations from the same z(0).

    Attributes:
        tau: Generative times.
        nominal: V without guidance, m^2.
        guided: V with guidance, m^2.
        bound: Of the guided one, m^2.
        enough: A V below which every requirement holds, m^2.
    """

    tau: Float[np.ndarray, " points"]
    nominal: Float[np.ndarray, " points"]
    guided: Float[np.ndarray, " points"]
    bound: Float[np.ndarray, " points"]
    enough: float


@look()
def draw_violations(curves: ViolationCurves) -> Figure:
    """V over tau on a logarithmic axis."""
    lengths = {len(each) for each in curves[:4]}
    if len(lengths) > 1:
        raise ValueError(f"`curves` must have one length; got {sorted(lengths)}.")
    figure, (axes,) = new_figure(2.6)
    axes.plot(curves.tau, _shown(curves.nominal), color=NOMINAL, label="nominal")
    axes.plot(curves.tau, _shown(curves.guided), color=GUIDED, label="guided")
    axes.plot(
        curves.tau, _shown(curves.bound), color=BOUND, linestyle=(0, (4, 2)), label="bound", lw=1.1
    )
    axes.axhline(curves.enough, color=GREY, linestyle=":", linewidth=1.0)
    axes.text(
        0.015, curves.enough * 0.82, "below: all requirements hold", color="#5A5A5A",
        fontsize=7.5, va="top",
    )  # fmt: skip
    top = max(float(np.max(each)) for each in (curves.nominal, curves.guided, curves.bound))
    axes.set(yscale="log", ylim=(LEAST, 3 * max(top, 10 * curves.enough)), xlim=(0.0, 1.0))
    axes.set(xlabel=r"generative time $\tau$", ylabel=r"$V^{\mathrm{PE}}$ (m$^2$)")
    above(figure, axes, columns=3)
    return figure


def _shown(values: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """What a logarithmic axis can show: a curve that comes to zero leaves through its lower end."""
    return np.maximum(values, 1e-3 * LEAST)
