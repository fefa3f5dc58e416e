"""Tables lose nothing of what they hold, however wide they are and wherever they are printed."""

import io
import re

import pytest
from rich.console import Console

from deggflow.app import tables
from deggflow.task import Table

CELLS = [f"{k}00.0% [98.{k}, 100.0]" for k in range(12)]
WIDE = Table("wide", [f"heading {k}" for k in range(12)], [CELLS, CELLS[::-1]], "a note")


def test_each_row_is_on_one_line_of_a_file(capsys):
    tables.show(WIDE)
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines if "│" in line]
    assert rows == WIDE.rows
    assert lines[-1] == "a note"


@pytest.mark.parametrize("width", [60, 80, 200])
def test_cells_are_wrapped_in_a_terminal(monkeypatch, width):
    file = io.StringIO()
    console = Console(file=file, width=width, force_terminal=True, color_system=None)
    monkeypatch.setattr(tables, "output", lambda: console)
    tables.show(WIDE)
    lines = file.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    columns = zip(*(line.strip("│┃").split("│") for line in lines if "│" in line), strict=True)
    held = ["".join(column) for column in columns]
    for column, first, last in zip(held, *WIDE.rows, strict=True):
        assert re.sub(r"\s", "", column) == re.sub(r"\s", "", first + last)
