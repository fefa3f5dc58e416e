"""Training curves as a figure."""

from matplotlib.figure import Figure

from deggflow.files import StrPath

from .style import save_figure


def draw_curves(source: StrPath, target: StrPath) -> None:
    """Draws the curves of a run (curves.csv) as PNG, PDF or SVG, by the target's ending."""
    from deggflow.train import read_curves

    curves = read_curves(source)
    figure = Figure(figsize=(4.5, 3.0), layout="constrained")
    axes = figure.subplots()
    steps = [curve.step for curve in curves]
    axes.plot(steps, [curve.training for curve in curves], color="#0072B2", label="training")
    axes.plot(steps, [curve.validation for curve in curves], color="#D55E00", label="validation")
    axes.set_xlabel("training step")
    axes.set_ylabel("flow-matching loss (per agent)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    save_figure(target, figure)
