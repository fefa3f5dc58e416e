"""Runs the commands of pages to their ends, and looks for the rows of the pages' tables among those that they print.

A row of a page may leave out cells of the printed one, and has the others in their order. Times, and columns of ratios of
times, differ from run to run and are not compared. Tables that no command prints are listed, too: definitions, figures of
others, or other commands.

Run: python benchmarks/docs_figures.py results.md bridge.md, in the environment of `make test`; hours for all pages
"""

import argparse
import csv
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from docs_commands import ELSEWHERE, PAGES, READ, commands_of, run, write_requested

EDGES = "│┃|"  # between the cells of tables drawn with lines, and of Markdown
RULE = re.compile(r"[┏┡├└].*|[|: -]+")
TIMES = re.compile(r"\b(times?|ratio|rounds|core-hours|ms)\b")  # in the name of a column
TIME = re.compile(r"\d (us|ms|s|min|h)\b")
SCRIPT = re.compile(r"`(python\s+benchmarks/[^`]+)`")  # within the text
HOURS = 4 * 3600  # s that a command may take
Row = tuple[str, ...]


class Table(NamedTuple):
    """A table, its cells in lower case and without markup.

    Attributes:
        where: Line of a page, or what printed it.
        header: Names of the columns.
        rows: Cells of each.
    """

    where: str
    header: Row
    rows: list[Row]


def _cells(line: str) -> Row:
    parts = re.split(rf"(?<!\\)[{EDGES}]", line.strip().strip(EDGES))
    return tuple(re.sub(r"[`*\\]", "", part).strip().lower() for part in parts)


def tables_of(text: str, name: str) -> Iterator[Table]:
    """The tables of a page, or of what a command printed."""
    table: Table | None = None
    for number, line in enumerate((*text.splitlines(), ""), 1):
        if line.strip() and RULE.fullmatch(line.strip()):
            continue
        if not line.strip().startswith(tuple(EDGES)):
            if table is not None:
                yield table
            table = None
        elif table is None:
            table = Table(f"{name}, line {number}", _cells(line), [])
        else:
            table.rows.append(_cells(line))


def files_of(folder: Path) -> Iterator[Table]:
    """The tables that a report left in the folder."""
    for path in sorted(folder.glob("**/tables/*.csv")):
        with path.open(newline="") as file:
            header, *rows = (tuple(cell.lower() for cell in row) for row in csv.reader(file))
        yield Table(path.name, header, rows)


def columns_of(table: Table) -> list[int]:
    """The columns that hold more than times."""
    return [
        place
        for place, name in enumerate(table.header)
        if not TIMES.search(name) and not all(TIME.search(row[place]) for row in table.rows)
    ]


def figures_of(table: Table) -> list[Row]:
    """The cells of each row, times left out; without rows of which fewer than three are left, as many rows hold those."""
    columns = columns_of(table)
    rows = (
        tuple(row[place] for place in columns if not TIME.search(row[place])) for row in table.rows
    )
    return [row for row in rows if len(row) > 2]


def missing_of(wanted: Table, printed: Sequence[Table]) -> list[Row]:
    """The rows of a table, times left out, that no printed row holds: all cells, in their order."""
    there = [row for table in printed for row in table.rows]
    return [row for row in figures_of(wanted) if not any(_holds(other, row) for other in there)]


def _holds(row: Row, cells: Row) -> bool:
    rest = iter(row)
    return all(cell in rest for cell in cells)


def is_printed(wanted: Table, printed: Sequence[Table], missing: Sequence[Row]) -> bool:
    """Whether a command prints this table, if with other figures: most of its columns, or some of its rows."""
    names = {wanted.header[place] for place in columns_of(wanted)}
    alike = any(2 * len(names & set(table.header)) > len(names) for table in printed)
    return alike or len(missing) < len(figures_of(wanted))


def check_page(page: Path, chosen: re.Pattern[str]) -> bool:
    """Runs a page's commands in order, those chosen, and compares its tables; whether figures differ or a command fails."""
    text = page.read_text()
    scripts = [" ".join(script.split()) for script in SCRIPT.findall(text)]
    with tempfile.TemporaryDirectory() as name:
        folder, printed, differ = Path(name), list[Table](), False
        for command in READ.get(page.name, ()):
            run(command, folder, 600)
        for command in dict.fromkeys([*commands_of(page), *scripts]):
            if ELSEWHERE.search(command) or not chosen.search(command):
                continue
            write_requested(command, folder)
            ended = run(command, folder, HOURS)
            print(f"{page.name}: {command}: {ended.how} ({ended.seconds:.0f} s)", flush=True)
            differ |= ended.how.startswith("FAILED")
            printed += [*tables_of(ended.output, command), *files_of(folder)]
    for table in tables_of(text, page.name):
        missing = missing_of(table, printed)
        if not is_printed(table, printed, missing):
            print(f"{table.where}: not printed by these commands: {' | '.join(table.header)}")
            continue
        count = len(figures_of(table))
        print(f"{table.where}: {count - len(missing)} of {count} rows printed")
        for row in missing:
            print(f"    not printed: {' | '.join(row)}")
        differ |= bool(missing)
    return differ


def main() -> int:
    """Checks the pages; exit code 1 if figures differ or a command fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("pages", nargs="*", help="names of pages, such as results.md; all if none")
    parser.add_argument(
        "--commands",
        type=re.compile,
        default=re.compile(""),
        help="run only those that this matches",
    )
    arguments = parser.parse_args()
    pages = [page for page in PAGES if not arguments.pages or page.name in arguments.pages]
    differ = [check_page(page, arguments.commands) for page in pages]
    return 1 if any(differ) else 0


if __name__ == "__main__":
    sys.exit(main())
