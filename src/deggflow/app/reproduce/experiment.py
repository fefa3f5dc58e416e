"""What an experiment is: something measured once, kept as JSON, and presented as often as wanted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[str], None]
"""Told what is being done, in a few words."""


@dataclass(frozen=True)
class Settings:
    """What a whole reproduction depends on; results of other settings are not used again."""

    seed: int = 1
    quick: bool = False
    folder: Path | None = None  # where an experiment may keep parts of a long measurement

    def cases(self, full: int, quick: int) -> int:
        """How many cases, in full or quick."""
        return quick if self.quick else full


@dataclass(frozen=True)
class DataTable:
    """A table of the report; also written as CSV and JSON."""

    name: str  # of its files
    caption: str
    columns: Sequence[str]
    rows: Sequence[
        Sequence[str | float | int | None]
    ]  # numbers are written in full, texts as they are


@dataclass(frozen=True)
class Plot:
    """A figure of the report; also written as PNG and PDF. Closed after it is written."""

    name: str  # of its files
    caption: str
    figure: "Figure"


@dataclass(frozen=True)
class Finding:
    """A line of the summary at the top of the report: the paper's figure beside ours."""

    what: str
    paper: str  # "-" where the paper gives none
    ours: str


@dataclass(frozen=True)
class Section:
    """One part of the report."""

    title: str
    paper: str  # which table or figure of the paper stands beside it, and what it says
    text: Sequence[str] = ()  # paragraphs
    tables: Sequence[DataTable] = ()
    plots: Sequence[Plot] = ()
    command: str | None = None  # what prints the same figures by itself
    summary: Sequence[Finding] = ()  # lines of the table at the top of the report


UNMET = "unmet"
"""Key of a result, if it has one: a list of texts, each a guided result that should be satisfied and is not.

The report shows them, and the command then exits with 3.
"""


class Experiment(Protocol):
    """One experiment; measured slowly, presented quickly."""

    name: str  # of its result's file, `results/<name>.json`

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """The result as JSON values, with its sample sizes."""

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """Tables and figures of a result; reads nothing but it."""
