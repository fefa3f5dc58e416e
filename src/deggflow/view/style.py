"""How figures of the report look: colours, sizes, letters, and how they are written.

Colours are Okabe and Ito's (2008), told apart by colour-blind readers too. A method has one colour everywhere.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deggflow.files import StrPath, write_atomically

NOMINAL, GUIDED = "#D55E00", "#0072B2"  # vermilion, blue
NATURAL = "#E69F00"  # orange: nominal, under the requirements that the field was trained for
BOUND = "#4D4D4D"  # what a theorem promises
OTHERS = ("#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#F0E442")  # further methods
GREY = "#8A8A8A"

COLUMN, PAGE = 3.4, 7.0  # inches, widths of a paper's column and page
_REPORT_DPI, _DPI = 220, 200  # of PNG files: of the report, and else
_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}

_LOOK: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.0,
    "errorbar.capsize": 2.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "pdf.fonttype": 42,  # TrueType: letters stay letters, as journals ask
}


@contextmanager
def look() -> Iterator[None]:
    """Within it figures are made and written in the report's look; also a decorator."""
    with mpl.rc_context(_LOOK):
        yield


def new_figure(
    height: float, *, width: float = COLUMN, columns: int = 1, **subplots: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with a row of axes; belongs to no window.

    Args:
        height: Inches.
        width: Inches; `COLUMN` or `PAGE`.
        columns: Number of axes beside each other.
        subplots: Further arguments of matplotlib's `Figure.subplots`.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    row = figure.subplots(1, columns, squeeze=False, **subplots)[0]
    return figure, list(row)


def above(figure: Figure, axes: Axes, *, columns: int) -> None:
    """The axes' legend in a line over the figure."""
    entries = axes.get_legend_handles_labels()
    figure.legend(*entries, loc="outside upper center", ncols=columns, columnspacing=1.4)


def name_hollow(axes: Axes, label: str) -> None:
    """A legend's entry for the open markers of all colours; the last one."""
    axes.errorbar(
        [np.nan], [np.nan], yerr=[0.0], color=GREY, linestyle="none", marker="o", markersize=3.6,
        markerfacecolor="white", label=label,
    )  # fmt: skip


def whole_numbers(axes: Axes, values: Any) -> None:
    """Ticks of the x axis at the values alone."""
    ticks = sorted({int(value) for value in np.ravel(values)})
    axes.set_xticks(ticks, [str(tick) for tick in ticks])


def written(figure: Figure, kind: Literal["png", "pdf"]) -> bytes:
    """The figure as a file's content: the same figure gives the same bytes."""
    with look():
        return _content(figure, kind, _REPORT_DPI)


def save_figure(path: StrPath, figure: Figure) -> None:
    """Writes a figure as PNG, PDF or SVG, by the file's ending; a kill leaves the old file or the new one."""
    write_atomically(path, _content(figure, Path(path).suffix.lstrip(".").lower(), _DPI))


def _content(figure: Figure, kind: str, dpi: int) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format=kind, dpi=dpi, metadata=_UNDATED.get(kind))
    return buffer.getvalue()
