"""Every command that the documentation shows is one that the program takes, with these options."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from deggflow.app import baselines, cli, commands, demo, export, run
from deggflow.app.reproduce import command as reproduce
from deggflow.studio import command as studio

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md", *(ROOT / "docs").glob("*.md"),
    *(ROOT / "examples" / "tutorials").glob("*.py"),
]  # fmt: skip
PLACEHOLDER = re.compile(r"[{}<>$]|\.\.\.|\b(?:TASK|FILE|FOLDER)\b|^deggflow (?:drones|needs)")


def commands_of(page):
    """Lines of shell blocks, and code spans that show a whole command; those with placeholders are left out."""
    text = re.sub(r"\n# ", "\n", page.read_text()) if page.suffix == ".py" else page.read_text()
    blocks = re.findall(r"```(?:sh|bash|console)\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    outside = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    spans = [" ".join(span.split()) for span in re.findall(r"`(deggflow [^`]+)`", outside)]
    for line in [*lines, *(span for span in spans if " --" in span)]:
        shown = re.search(r"\bdeggflow .*", line.removeprefix("$ ").split(" #")[0])
        if shown and not line.startswith("#") and not PLACEHOLDER.search(shown[0]):
            yield shown[0].strip()


SHOWN = sorted({(command, page.name) for page in PAGES for command in commands_of(page)})


class TakenError(Exception):
    """The options were read, and the work would begin."""


def take(*_):
    raise TakenError


def test_commands_are_found():
    assert len(SHOWN) > 60


@pytest.mark.parametrize(("shown", "page"), SHOWN, ids=lambda text: str(text))
def test_the_program_takes_it(shown, page, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    for module in (baselines, commands, demo, export, run, reproduce):
        monkeypatch.setattr(module, "prepare_jax", take)
    monkeypatch.setattr(studio, "_listener", take)  # it serves until Ctrl-C
    for package in ("ray", "zenoh"):  # extras
        monkeypatch.setitem(sys.modules, package, sys.modules[__name__])
    with pytest.raises((TakenError, SystemExit)) as raised:
        cli.main(shlex.split(shown)[1:])
    if isinstance(raised.value, SystemExit) and raised.value.code != 0:
        said = capsys.readouterr().err
        assert re.match(r"deggflow: .*(can't be read|No such file|is no file of a run)", said), said
