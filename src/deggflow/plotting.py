"""Pictures of one's own problem, from any generation, certificate or batch of samples, by matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .certificate import Certificate, TraceRecord
from .generation import Generation, check_one_sample
from .sampling import Samples
from .trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GUIDED, FAULT, GREY = "#0072b2", "#d4201f", "#8a8a8a"  # as in notebooks
SHOWN = 64  # samples in one picture
_LEAST = 1e-12  # of a logarithmic axis

Drawn = Generation | Certificate | Samples


def plot(
    result: Drawn, *, names: Sequence[str] | None = None, axes: "Sequence[Axes] | None" = None
) -> "Figure":
    """Draws whatever a result holds, one picture beside the other.

    - A `Generation` of one sample with `keep_trace`: each requirement's V or q against its bound and its limit, and the
      size of every agent's input; with `keep_path`: the paths of the agents in their first two coordinates.
    - A `Certificate`: the margins, and with `keep_trace` V or q against bound and limit.
    - `Samples`: the least margin of each sample, and the final states; samples that are not satisfied are red.

    Args:
        result: What to draw.
        names: Names of the requirements of a generation; certificates have their own.
        axes: Where to draw, as many axes as there are pictures; new ones by default.

    Returns:
        The figure. Nothing is shown or saved.

    Raises:
        TypeError: `result` is none of these.
        ValueError: It is a batch, it holds nothing that can be drawn, or `axes` are not as many as the pictures.

    Example:
        >>> figure = plot(generate(field, guidance, z0, condition, keep_path=True), names=["apart"])
        >>> [axes.get_title() for axes in figure.axes]
        ['apart', 'inputs', 'paths']
    """
    pictures = _pictures(result, names)
    if not pictures:
        raise ValueError(
            "`result` holds nothing to draw: pass `keep_trace=True` or `keep_path=True` where it is made."
        )
    if axes is None:
        from matplotlib import pyplot

        _, grid = pyplot.subplots(
            1,
            len(pictures),
            figsize=(4.2 * len(pictures), 3.4),
            layout="constrained",
            squeeze=False,
        )
        axes = list(grid[0])
    if len(axes) != len(pictures):
        raise ValueError(f"`axes` must be {len(pictures)} for these pictures; got {len(axes)}.")
    for (draw, *content), each in zip(pictures, axes, strict=True):
        draw(each, *content)
    figure = axes[0].get_figure()
    assert figure is not None
    return figure  # type: ignore[return-value]  # a subfigure is as good


def _pictures(result: Drawn, names: Sequence[str] | None) -> list[tuple[Any, ...]]:
    """Functions that draw on axes, each with its further arguments."""
    if isinstance(result, Samples):
        return [(_least_margins, result), (_states, result)]
    if isinstance(result, Certificate):
        margins = [(_margins, result)] if result.verdicts else []
        trace = None if result.generation is None else result.generation.trace
        if trace is None or result.generation is None:
            return margins
        return margins + _of_trace(trace, [each.name for each in result.generation.requirements])
    advice = "pick one by `jax.tree.map(lambda leaf: leaf[0], result)`"
    check_one_sample("result", result, "a `Generation`, a `Certificate` or `Samples`", advice)
    pictures = []
    if result.trace is not None:
        rows = np.shape(result.trace.value)[1]
        known = [f"requirement {row + 1}" for row in range(rows)] if names is None else list(names)
        if len(known) != rows:
            raise ValueError(
                f"`names` must be {rows} names, one for each requirement; got {known}."
            )
        pictures += [*_of_trace(result.trace, known), (_inputs, result.trace)]
    if result.path is not None and np.shape(result.path)[-1] > 1:
        pictures.append((_paths, np.asarray(result.path)))
    return pictures


def _of_trace(trace: Trace | TraceRecord, names: Sequence[str]) -> list[tuple[Any, ...]]:
    value, bound, limit = (
        np.asarray(each, np.float64) for each in (trace.value, trace.bound, trace.limit)
    )
    tau = np.asarray(trace.tau)
    return [
        (_value, name, tau, value[:, row], bound[:, row], limit[:, row])
        for row, name in enumerate(names)
    ]


def _value(
    axes: "Axes",
    name: str,
    tau: np.ndarray,
    value: np.ndarray,
    bound: np.ndarray,
    limit: np.ndarray,
) -> None:
    """V or q below its bound and its limit; on a logarithmic axis where it is never negative."""
    curves = (value, bound, limit)
    if logarithmic := bool(np.all(value >= 0)):
        curves = tuple(np.maximum(each, _LEAST) for each in curves)
    axes.plot(tau, curves[0], color=GUIDED, linewidth=1.8, label="V" if logarithmic else "q")
    axes.plot(tau, curves[1], color="black", linestyle="--", linewidth=1, label="bound")
    axes.plot(tau, curves[2], color=GREY, linestyle=":", linewidth=1.4, label="limit of a step")
    if logarithmic:
        axes.set_yscale("log")
    axes.set(title=name, xlabel="tau")
    axes.legend(fontsize="small")


def _inputs(axes: "Axes", trace: Trace) -> None:
    """|u_i| of every agent; the last point has no input."""
    norms = np.asarray(trace.input_norm)[:-1]
    for agent, norm in enumerate(norms.T):
        axes.plot(np.asarray(trace.tau)[:-1], norm, linewidth=1, label=f"agent {agent}")
    axes.set(title="inputs", xlabel="tau", ylabel="|u|")
    if norms.shape[1] <= 10:
        axes.legend(fontsize="small")


def _paths(axes: "Axes", path: np.ndarray) -> None:
    """Every agent's first two coordinates from z(0) (a ring) to z(1) (a dot)."""
    for agent in np.moveaxis(path[..., :2], 1, 0):
        (line,) = axes.plot(*agent.T, linewidth=1)
        axes.plot(*agent[0], "o", color=line.get_color(), fillstyle="none", markersize=5)
        axes.plot(*agent[-1], "o", color=line.get_color(), markersize=5)
    axes.set(title="paths", xlabel="z[0]", ylabel="z[1]", aspect="equal", adjustable="datalim")


def _margins(axes: "Axes", certificate: Certificate) -> None:
    """The least margin of every requirement; a violated one is red."""
    names = [each.name for each in certificate.verdicts]
    margins = [each.margin for each in certificate.verdicts]
    bars = axes.barh(names, margins, color=[FAULT if each < 0 else GUIDED for each in margins])
    axes.bar_label(bars, [f"{each:.3g}" for each in margins], padding=3)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.margins(x=0.25)
    axes.invert_yaxis()
    axes.set(title="satisfied" if certificate.satisfied else "NOT satisfied", xlabel="least margin")


def _least_margins(axes: "Axes", samples: Samples) -> None:
    margins = np.array([each.min_margin for each in samples.certificates])
    finite = np.isfinite(margins)
    colours = np.where(samples.satisfied, GUIDED, FAULT)
    order = np.argsort(margins[finite])
    axes.scatter(np.arange(len(order)), margins[finite][order], s=8, c=list(colours[finite][order]))
    axes.axhline(0.0, color="black", linewidth=0.8)
    title = f"{samples.satisfied.sum()} of {len(samples)} satisfied"
    axes.set(title=title, xlabel="samples, sorted", ylabel="least margin")


def _states(axes: "Axes", samples: Samples) -> None:
    """The first two coordinates of the first samples' agents; of agents with one coordinate, that one."""
    for z, satisfied in zip(samples.z[:SHOWN], samples.satisfied[:SHOWN], strict=True):
        first, second = z[:, 0], z[:, min(1, z.shape[1] - 1)]
        axes.scatter(first, second, s=8, alpha=0.6, color=GUIDED if satisfied else FAULT)
    shown = min(SHOWN, len(samples))
    axes.set(
        title=f"z(1) of {shown} samples",
        xlabel="z[0]",
        ylabel="z[1]",
        aspect="equal",
        adjustable="datalim",
    )
