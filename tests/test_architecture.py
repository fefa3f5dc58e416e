"""Imports go one way: core maths -> tasks -> view -> app and studio."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import deggflow

ROOT = Path(deggflow.__file__).parent
FLOORS = [
    {
        "blocks",
        "divergence",
        "files",
        "extras",
        "jsonl",
        "lazy",
        "lines",
        "locks",
        "merging",
        "output",
        "schema",
        "shards",
        "tables",
        "statistics",
        "flow",
        "field",
        "guidance",
        "neighbours",
        "requirements",
        "weights",
        "shapes",
        "solver",
    },
    {
        "baselines",
        "arguments",
        "drift",
        "frames",
        "loggers",
        "plotting",
        "pretrained",
        "guided_field",
        "trace",
        "generation",
        "hints",
        "step_guard",
        "certificate",
        "consistency",
        "contradiction",
        "certification",
        "identity",
        "judge",
        "notebook",
        "recording",
        "records",
        "redraw",
        "sampler",
        "sampling",
        "torch",
        "train",
        "deviation",
    },
    {"runtime"},
    {"task"},
    {"tasks"},
    {"view"},
    {"app", "studio"},
]
FLOOR = {room: height for height, rooms in enumerate(FLOORS) for room in rooms}
# Within the lowest floor: maths knows nothing of files, and files nothing of maths.
APART = {"flow": {"files", "jsonl"}, "guidance": {"files", "jsonl"}, "field": {"files", "jsonl"}}


def imports(path):
    """Rooms of the package that a file imports."""
    home = path.relative_to(ROOT).parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level:
            base = ("deggflow", *home[: len(home) - node.level], *(node.module or "").split("."))
            names = [".".join(part for part in base if part)]
            if names == ["deggflow"]:
                names = [f"deggflow.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module]
            if node.module == "deggflow":
                names = [f"deggflow.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            if name.startswith("deggflow.") and name != "deggflow.__version__":
                yield name.split(".")[1]


FILES = [path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_room_imports_only_from_rooms_below_it(path):
    room = path.relative_to(ROOT).parts[0].removesuffix(".py")
    for other in imports(path):
        assert FLOOR[other] <= FLOOR[room], f"{room} imports {other}"
        assert other not in APART.get(room, ()), f"{room} imports {other}"


@pytest.mark.parametrize("path", sorted((ROOT / "view").glob("*.py")), ids=lambda p: p.name)
def test_what_tasks_share_in_pictures_knows_no_task(path):
    text = path.read_text()
    assert "tasks" not in set(imports(path))
    for name in ("deggflow.tasks", ".tabletop", ".bridge"):
        assert name not in text, f"{path.name} names {name}"


def test_files_stay_readable():
    home = Path(__file__).parents[1]
    scripts = [
        path for room in ("tests", "benchmarks", "examples") for path in (home / room).rglob("*.py")
    ]
    assert len(scripts) > 200
    long = [path.name for path in (*FILES, *scripts) if len(path.read_text().splitlines()) > 400]
    assert not long


@pytest.mark.parametrize("module", ["deggflow", "deggflow.app.cli", "deggflow.view"])
def test_the_command_starts_without_jax(module):
    code = f"import sys, {module}; sys.exit(any(m in sys.modules for m in ('jax', 'mujoco', 'matplotlib')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_names_of_the_package_are_what_they_say():
    """Whatever was imported before, `deggflow.generate` is the function."""
    code = "import deggflow.generation, deggflow; assert all(getattr(deggflow, n) for n in deggflow.__all__)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
