"""The interface of experiments: each is measured once, kept as JSON, and presented any number of times."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[str], None]
"""Called with a short text on the current activity."""


@dataclass(frozen=True)
class Settings:
    """Settings of a whole reproduction; results of other settings are not reused.

    Attributes:
        seed: Seed of cases and of z(0).
        quick: Whether to run few cases.
        folder: Where an experiment may keep parts of a long measurement; None keeps nothing.
    """

    seed: int = 1
    quick: bool = False
    folder: Path | None = None

    def cases(self, full: int, quick: int) -> int:
        """The number of cases of a full or a quick run."""
        return quick if self.quick else full


@dataclass(frozen=True)
class DataTable:
    """A table of the report; also written as CSV and JSON.

    Attributes:
        name: Name of its files.
        caption: Its caption.
        columns: Headings.
        rows: Cells. Files hold numbers in full precision.
    """

    name: str
    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str | float | int | None]]


@dataclass(frozen=True)
class Plot:
    """A figure of the report; also written as PNG and PDF.

    Attributes:
        name: Name of its files.
        caption: Its caption.
        figure: The figure; it is cleared after it is written.
    """

    name: str
    caption: str
    figure: "Figure"


@dataclass(frozen=True)
class Finding:
    """A line of the summary at the top of the report.

    Attributes:
        what: The quantity.
        paper: The paper's value; "-" if it gives none.
        ours: Our value.
    """

    what: str
    paper: str
    ours: str


@dataclass(frozen=True)
class Section:
    """One section of the report.

    Attributes:
        title: Heading.
        paper: The table or figure of the paper that it reproduces, and the paper's result.
        text: Paragraphs.
        tables: Tables.
        plots: Figures.
        command: The command that prints the same numbers.
        summary: Lines of the summary at the top of the report.
    """

    title: str
    paper: str
    text: Sequence[str] = ()
    tables: Sequence[DataTable] = ()
    plots: Sequence[Plot] = ()
    command: str | None = None
    summary: Sequence[Finding] = ()


UNMET = "unmet"
"""Optional key of a result: a list of messages on guided results, claims or bounds that fail.

The report shows them, and the command exits with 3.
"""


class Experiment(Protocol):
    """One experiment; measuring is slow, presenting is fast.

    Attributes:
        name: Name of its result's file, `results/<name>.json`.
    """

    name: str

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Measures the result: JSON values, including sample sizes."""

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """The section of a result; depends on nothing else."""
