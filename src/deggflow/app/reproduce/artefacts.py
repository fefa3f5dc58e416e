"""Files of a section: tables as CSV and JSON, figures as PNG and PDF."""

import csv
import json
import re
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from deggflow.files import write_atomically
from deggflow.view.style import written

from .experiment import DataTable, Plot, Section

_FILE_NAME = re.compile(r"[a-z0-9_]+")


class WrittenPlot(NamedTuple):
    """A figure that was written to files.

    Attributes:
        name: Name of its files.
        caption: Its caption.
        png: The picture as PNG.
        width: Width of the figure, inches.
        links: Its files, relative to the report.
    """

    name: str
    caption: str
    png: bytes
    width: float
    links: tuple[str, ...]


class WrittenTable(NamedTuple):
    """A table that was written to files.

    Attributes:
        table: The table.
        links: Its files, relative to the report.
    """

    table: DataTable
    links: tuple[str, ...]


class Artefacts(NamedTuple):
    """The tables and figures of a section."""

    tables: list[WrittenTable]
    plots: list[WrittenPlot]


def table_csv(table: DataTable) -> str:
    """The table as comma-separated values: numbers in full, None as an empty cell."""
    text = StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(table.columns)
    lines.writerows(["" if cell is None else cell for cell in row] for row in table.rows)
    return text.getvalue()


def table_json(table: DataTable) -> str:
    """The table as a JSON object."""
    content = {
        "name": table.name,
        "caption": table.caption,
        "columns": list(table.columns),
        "rows": [list(row) for row in table.rows],
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def check_names(sections: Sequence[Section]) -> None:
    """Refuses duplicate names, names that are not valid file names, and tables that are not rectangular."""
    for kind in ("tables", "plots"):
        names = [each.name for section in sections for each in getattr(section, kind)]
        for name in names:
            if not _FILE_NAME.fullmatch(name) or names.count(name) > 1:
                raise ValueError(
                    f"`name` of {kind} must be unique and consist of a-z, 0-9 and _; got {name!r}."
                )
    for table in (table for section in sections for table in section.tables):
        if any(len(row) != len(table.columns) for row in table.rows):
            raise ValueError(f"every row of table {table.name!r} must have a cell for each column.")


def write(section: Section, out: Path) -> Artefacts:
    """Writes a section's tables and figures into folders `tables` and `figures`."""
    return Artefacts(
        [_write_table(table, out) for table in section.tables],
        [_write_plot(plot, out) for plot in section.plots],
    )


def _write_table(table: DataTable, out: Path) -> WrittenTable:
    links = []
    for ending, content in (("csv", table_csv(table)), ("json", table_json(table))):
        links.append(f"tables/{table.name}.{ending}")
        write_atomically(out / links[-1], content)
    return WrittenTable(table, tuple(links))


def _write_plot(plot: Plot, out: Path) -> WrittenPlot:
    png, pdf = written(plot.figure, "png"), written(plot.figure, "pdf")
    links = (f"figures/{plot.name}.png", f"figures/{plot.name}.pdf")
    for link, content in zip(links, (png, pdf), strict=True):
        write_atomically(out / link, content)
    width = float(plot.figure.get_size_inches()[0])
    plot.figure.clear()  # frees its memory; the figure is not drawn again
    return WrittenPlot(plot.name, plot.caption, png, width, links)
