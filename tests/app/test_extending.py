"""docs/extending.md, as a reader follows it: the file, the registry line, the six commands; and what goes wrong."""

import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
CODE, PROJECT, COMMANDS = (
    re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1] for kind in ("python", "toml", "console")
)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The reader's folder, with what `pip install -e .` adds: the entry points of its pyproject.toml."""
    (tmp_path / "drones.py").write_text(CODE)
    points = tomllib.loads(PROJECT)["project"]["entry-points"]
    lines = [
        line
        for group, entries in points.items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in entries.items()))
    ]
    info = tmp_path / "drones-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: drones\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    sys.modules.pop("drones", None)


def margins_by_hand(row):
    """Every margin of a line (m), from the numbers of the page's text alone."""
    states = np.array(row["agents"])
    x, y, radius = row["condition"]["zone"]
    pairs = [np.hypot(*(a - b)) - 0.8 for k, a in enumerate(states) for b in states[k + 1 :]]
    zone = np.hypot(states[:, 0] - x, states[:, 1] - y) - radius
    centre = 0.2 - np.hypot(*(states.sum(axis=0) / len(states) - row["condition"]["target"]))
    return [*pairs, *zone, centre]


def test_a_task_is_a_page_and_one_registry_line():
    assert len(CODE.splitlines()) <= 150
    assert len(tomllib.loads(PROJECT)["project"]["entry-points"]["deggflow.tasks"]) == 1


def test_the_page_does_what_it_says(installed, inside):
    said = {}
    for command in COMMANDS.splitlines():
        name, *arguments = command.removeprefix("$ ").split()
        assert name == "deggflow"
        ended = inside(*arguments)
        assert ended.returncode == 0, ended.stderr
        said[arguments[1]] = ended.stdout + ended.stderr
    assert list(said) == ["data", "train", "generate", "certify", "evaluate", "render"]
    assert "50 of 50 formations satisfy every requirement." in said["generate"]
    assert "50 of 50 formations satisfy every requirement; 0 lines" in said["certify"]
    rows = [json.loads(line) for line in (installed / "formations.jsonl").read_text().splitlines()]
    assert len(rows) == 50
    for row in rows:
        assert len(row["agents"]) == 6
        margins = margins_by_hand(row)
        assert min(margins) >= 0
        assert row["certificate"]["satisfied"]
    assert said["evaluate"].count("100.0% [92.9, 100.0]") >= 3
    for number in (1, 2, 3):
        assert (installed / f"pictures/formation_000{number}.png").stat().st_size > 5000
    tamper(installed, inside, rows)
    bad_input(installed, inside)


def certified(folder, inside, rows):
    (folder / "changed.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return inside("drones", "certify", "changed.jsonl")


def tamper(folder, inside, rows):
    """What a line says that is not so is found, and so is a drone in the zone."""
    first = json.dumps(rows[0])
    for change, field in (
        (lambda row: row["agents"].__setitem__(0, row["condition"]["zone"][:2]), "satisfied"),
        (lambda row: row["certificate"].update(min_margin=0.3), "min_margin"),
        (lambda row: row["certificate"].update(satisfied=False, reason="no"), "satisfied"),
        (lambda row: row["certificate"].update(reason="no"), "reason"),
        (lambda row: row["certificate"]["verdicts"].pop(), "verdicts"),
        (lambda row: row["certificate"]["verdicts"][0].update(margin=0.1), "verdicts[0].margin"),
    ):
        row = json.loads(first)
        change(row)
        ended = certified(folder, inside, [row])
        assert ended.returncode == 3
        assert f"field `certificate.{field}`" in ended.stdout


def bad_input(folder, inside):
    """One line that names file, line, field and reason, and exit code 2."""
    good = {"drones": 3, "target": [0.0, 0.0], "zone": [2.0, 0.0, 0.5]}
    for change, hint in (
        ({"drones": 9}, "wanted.jsonl, line 1: must have 2 to 8 agents; got 9"),
        ({"drones": "3"}, "wanted.jsonl, line 1, field `drones`: must be an integer"),
        ({"zone": [1.0, 2.0]}, "wanted.jsonl, line 1, field `zone`: must hold 3 values; got 2"),
        ({"wind": 1.0}, "wanted.jsonl, line 1, field `wind`: "),
    ):
        (folder / "wanted.jsonl").write_text(json.dumps({**good, **change}) + "\n")
        ended = inside(
            "drones", "generate", "--conditions", "wanted.jsonl", "--weights", "run/field.safetensors"
        )  # fmt: skip
        assert ended.returncode == 2
        assert f"deggflow: {hint}" in ended.stderr
    ended = inside("drones", "generate", "--size", 3)
    assert ended.returncode == 2
    assert "drones has no default weights; give --weights FILE" in ended.stderr
    ended = inside("tabletop", "generate", "--size", 3, "--weights", "run/field.safetensors")
    assert ended.returncode == 2
    ended = inside("drones", "evaluate", "--sizes", 9, "--weights", "run/field.safetensors")
    assert ended.returncode == 2
    assert "--sizes must lie in [2, 8]; got 9" in ended.stderr


def test_a_task_that_cannot_be_imported_is_named(installed, inside):
    (installed / "drones.py").write_text("import no_such_module\n")
    ended = inside("drones", "generate", "--size", 3)
    assert ended.returncode == 2
    assert "the task 'drones', registered as 'drones:DroneTask', can't be loaded" in ended.stderr
    assert inside("tabletop", "--help").returncode == 0


def test_the_commands_of_a_task_are_listed(installed, inside):
    assert "drones" in inside("--help").stdout
    assert "Generate formations, each with its certificate" in inside("drones", "--help").stdout
