"""The paths that planks take, drawn from above."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.files import StrPath
from deggflow.tasks.bridge.world import GAP_LEFT, GAP_RIGHT, Y_MIN

_GAP = "#cbc6bc"  # light, as lines cross it


class PathGroup(NamedTuple):
    """Paths of the plank's centre that are drawn alike.

    Attributes:
        label: In the legend.
        colour: Of all its lines.
        paths: Points of each path, m.
    """

    label: str
    colour: str
    paths: Sequence[Float[np.ndarray, "_ 2"]]


def draw_paths(path: StrPath, groups: Sequence[PathGroup]) -> None:
    """Draws the paths of plank centres from above, over workspace and gap.

    Args:
        path: The file; its ending decides: ".pdf", ".svg" or ".png".
        groups: Each has its colour and its entry in the legend.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    from deggflow.view.style import save_figure

    from .topview import draw_world

    figure = Figure(figsize=(6.4, 3.4), layout="compressed")
    axes = figure.subplots()
    draw_world(axes, pit=_GAP)
    axes.text(
        (GAP_LEFT + GAP_RIGHT) / 2, Y_MIN + 0.2, "gap", color="#57524b", fontsize=9, ha="center"
    )
    for group in groups:
        alpha = float(np.clip(6.0 / max(len(group.paths), 1), 0.15, 0.9))
        lines = LineCollection(
            group.paths, colors=group.colour, alpha=alpha, linewidths=0.9, zorder=3
        )
        axes.add_collection(lines, autolim=False)
        ends = np.array([path[-1] for path in group.paths if len(path)]).reshape(-1, 2)
        axes.scatter(*ends.T, s=5, color=group.colour, alpha=min(2 * alpha, 1.0), lw=0, zorder=3.5)
        count = len(group.paths)
        axes.plot([], [], color=group.colour, linewidth=2.0, label=f"{group.label} ({count})")
    if groups:
        figure.legend(frameon=False, fontsize=9, loc="outside upper center", ncols=len(groups))
    save_figure(path, figure)
