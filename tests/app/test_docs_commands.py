"""Commands in the documentation are those that there are: each is parsed as a user's would be, and not run."""

import functools
import inspect
import re
import shlex
from pathlib import Path

import docs_commands
import docs_figures
import pytest
from tyro.extras import SubcommandApp

from deggflow.app.cli import main
from deggflow.app.reproduce.curves import shipped_curves
from deggflow.app.reproduce.registry import entries

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "api").glob("*.md")),
]  # fmt: skip
OTHER_TASK = ("deggflow", "drones")  # of extending.md, which has a test of its own
CODE = re.compile(r"`((?:deggflow|python|make) [^`]+)`")


def commands_of(page):
    """Those of code blocks, which are whole, and those within the text, which may leave out what must be given."""
    for line in docs_commands.commands_of(page, (*docs_commands.HERE, "bash")):
        words = shlex.split(line)
        if tuple(words[:2]) != OTHER_TASK:
            yield words, True
    for code in CODE.findall(docs_commands.BLOCK.sub("", page.read_text())):
        yield shlex.split(code), False


COMMANDS = sorted(
    {(page.name, shlex.join(words), whole) for page in PAGES for words, whole in commands_of(page)}
)


def those_of(program):
    return [
        pytest.param(shlex.split(command)[1:], whole, id=f"{page}: {command}")
        for page, command, whole in COMMANDS
        if command.split()[0] == program
    ]


@pytest.fixture
def parsed(monkeypatch):
    """The commands that would have run, by name, with their arguments."""
    calls, register = [], SubcommandApp.command

    def command(app, function=None, **settings):
        if function is None:
            return lambda function: command(app, function, **settings)
        if isinstance(function, SubcommandApp):
            return register(app, function, **settings)

        @functools.wraps(function)
        def parse_only(*args, **kwargs):
            calls.append((function.__name__, inspect.signature(function).bind(*args, **kwargs)))
            return 0

        return register(app, parse_only, **settings)

    monkeypatch.setattr(SubcommandApp, "command", command)
    return calls


def test_there_are_commands():
    assert len(those_of("deggflow")) > 30
    assert len(those_of("python")) > 5


@pytest.mark.parametrize(("arguments", "whole"), those_of("deggflow"))
def test_a_deggflow_command_is_accepted(arguments, whole, parsed, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    output = "".join(capsys.readouterr())
    if end.value.code == 0:
        assert len(parsed) == 1 or {"--help", "--version"} & set(arguments)
        names = {entry.experiment.name for entry in entries(shipped_curves())}
        for command, bound in parsed:
            if command == "reproduce":
                assert set(bound.arguments["only"]) <= names
    else:
        assert not whole, output
        assert "Required options" in output, output


@pytest.mark.parametrize(("arguments", "whole"), those_of("python"))
def test_a_script_exists_with_its_options(arguments, whole):
    script, *rest = arguments
    path = ROOT / script
    assert path.is_file()
    suite = [path, *(path.parent / "suite").glob("*.py")] if path.name == "run.py" else [path]
    source = "\n".join(each.read_text() for each in suite)
    for word in rest:
        if not word.isdigit():
            assert re.search(rf"\b{re.escape(word.removeprefix('--'))}\b", source), word


@pytest.mark.parametrize(("arguments", "whole"), those_of("make"))
def test_a_make_target_exists(arguments, whole):
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert arguments[0] in targets


@pytest.mark.parametrize("arguments", [["tabletop", "generate", "--no-such-option", "1"], ["none"]])
def test_what_does_not_exist_is_refused(arguments, parsed, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert not parsed
    assert "Required options" not in "".join(capsys.readouterr())


PRINTED = """
Success, 20 cases per row
┏━━━┳━━━━━━━━━━━━━━━━━━━━━━┳━━━━━━━━━━┳━━━━━━━━┓
┃ N ┃ guided               ┃ refuted  ┃ time   ┃
┡━━━╇━━━━━━━━━━━━━━━━━━━━━━╇━━━━━━━━━━╇━━━━━━━━┩
│ 4 │ 100.0% [83.9, 100.0] │ 0        │ 3.1 ms │
│ 5 │ 95.0% [76.4, 99.1]   │ 1        │ 3.5 ms │
└───┴──────────────────────┴──────────┴────────┘
refuted: claims that are false

| way | cases | least |
|---|---|---|
| ours | 20 | -0.1 |
"""


@pytest.mark.parametrize(
    ("page", "missing"),
    [
        ("| 4 | **100.0%** [83.9, 100.0] | 0 | 9.9 ms |", []),
        ("| 5 | 95.0% [76.4, 99.1] | 0 | 3.5 ms |", [("5", "95.0% [76.4, 99.1]", "0")]),
        ("| 4 | 95.0% [76.4, 99.1] | 1 | |", [("4", "95.0% [76.4, 99.1]", "1", "")]),
        ("| 5 | 1 | 1 | 3.5 ms |", [("5", "1", "1")]),
        ("| `Ours` | 20 | -0.1 | 1 s |\n| ours | 20 | -0.2 | 1 s |", [("ours", "20", "-0.2")]),
    ],
    ids=["a time", "another figure", "of another row", "once more", "markdown"],
)
def test_rows_of_a_page_are_sought_among_those_printed(page, missing):
    printed = [*docs_figures.tables_of(PRINTED, "command")]
    assert [len(table.rows) for table in printed] == [2, 1]
    head = "| N | guided | refuted | least |\n|--:|:-:|---|---|\n"
    (table,) = docs_figures.tables_of(f"text\n{head}{page}\n\ntext\n", "page")
    assert docs_figures.missing_of(table, printed) == missing
    assert docs_figures.is_printed(table, printed, missing)


def test_a_table_that_nothing_prints_is_told_from_one_with_other_figures():
    printed = [*docs_figures.tables_of(PRINTED, "command")]
    (table,) = docs_figures.tables_of(
        "| word | its meaning | where |\n|---|---|---|\n| a \\| b | c | d |\n", "page"
    )
    assert table.rows == [("a | b", "c", "d")]
    assert not docs_figures.is_printed(table, printed, table.rows)


def test_columns_of_times_are_not_compared():
    printed = [*docs_figures.tables_of(PRINTED, "command")]
    page = "| N | batch | guided | ratio |\n|---|---|---|---|\n| 4 | 1 | 2.0 ms | 1.4 |\n"
    (table,) = docs_figures.tables_of(page, "page")
    assert docs_figures.columns_of(table) == [0, 1]
    assert docs_figures.figures_of(table) == []
    assert not docs_figures.is_printed(table, printed, [])
