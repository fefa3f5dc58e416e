"""The commands that write, and folders in which they run with and without faults."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PATIENCE = 600.0  # s, for one process on a slow machine
LIMITED = """
import resource, sys

room = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
from deggflow.app.start import main

main()
"""  # files may not grow beyond some size: as on a full disk, a write fails in its middle


def whole(path: Path) -> object:
    """What is compared of a file: its bytes."""
    return path.read_bytes() if path.exists() else None


def measured(path: Path) -> object:
    """What is compared of a result that also says how long it took."""
    return json.loads(path.read_bytes())["result"] if path.exists() else None


def drawn(path: Path) -> object:
    """What is compared of a picture: that it is one."""
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" if path.exists() else None


@dataclass(frozen=True)
class Job:
    """A command that writes, run in a folder of its own."""

    command: tuple[object, ...]
    other: tuple[object, ...]  # arguments with which it is another run
    files: tuple[str, ...]  # that it leaves
    lines: tuple[str, ...] = ()  # of these, the ones that are written line by line
    needs: tuple[str, ...] = ()  # files and folders that it reads
    compared: Callable[[Path], object] = whole
    share: float = 1.0  # of the faults

    @property
    def name(self) -> str:
        """What it is called."""
        return " ".join(map(str, self.command[:2]))

    @property
    def out(self) -> str:
        """What is removed and replaced."""
        return self.files[0]


def jobs() -> list[Job]:
    """Every command that writes, small."""
    weights = "w.safetensors"
    return [
        Job(("tabletop", "generate", "--size", 3, "--count", 1300, "--out", "o/a.jsonl", "--weights", weights),
            ("--seed", 1), ("o/a.jsonl",), ("o/a.jsonl",), (weights, "w.json"), share=2),
        Job(("tabletop", "data", "--training", 6, "--validation", 3, "--out", "o"),
            ("--seed", 1), ("o/training.jsonl", "o/validation.jsonl"), ("o/training.jsonl", "o/validation.jsonl"), share=2),
        Job(("tabletop", "train", "--data", "td", "--steps", 1500, "--batch", 4, "--width", 8, "--rounds", 1,
             "--head-width", 8, "--out", "o"), ("--seed", 1),
            ("o/curves.csv", "o/field.safetensors", "o/field.json", "o/config.json"), needs=("td",)),
        Job(("tabletop", "evaluate", "--cases", 3, "--sizes", 1, 2, 3, "--out", "o/rows.jsonl"),
            ("--seed", 2), ("o/rows.jsonl",), ("o/rows.jsonl",), share=0.5),
        Job(("bridge", "generate", "--size", 3, "--count", 3, "--out", "o/t.jsonl"),
            ("--seed", 1), ("o/t.jsonl",), ("o/t.jsonl",), share=1),
        Job(("bridge", "data", "--training", 2, "--validation", 1, "--out", "o"),
            ("--seed", 1), ("o/training.jsonl", "o/validation.jsonl"), ("o/training.jsonl", "o/validation.jsonl"), share=5),
        Job(("bridge", "train", "--data", "bd", "--steps", 1000, "--batch", 2, "--out", "o"), ("--seed", 1),
            ("o/curves.csv", "o/field.safetensors", "o/field.json", "o/config.json"), needs=("bd",), share=0.3),
        Job(("bridge", "evaluate", "--trials", 1, "--sizes", 2, 3, "--out", "o/rows.jsonl"),
            ("--seed", 2), ("o/rows.jsonl",), ("o/rows.jsonl",), share=0.3),
        Job(("tabletop", "render", "s.jsonl", "--renderer", "matplotlib", "--out", "o"),
            (), ("o/scene_0001.png", "o/scene_0002.png"), needs=("s.jsonl",), compared=drawn, share=3),
        Job(("reproduce", "--quick", "--only", "training_curves", "--out", "o"),
            (), ("o/results/training_curves.json",), compared=measured, share=1),
    ]  # fmt: skip


class Stage:
    """Folders with what commands read, and what they leave without faults."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.environment = {
            **os.environ,
            "DEGGFLOW_CACHE": str(home / "cache"),
            "MPLBACKEND": "agg",
        }
        self.given = home / "given"
        self.given.mkdir()
        self.known: dict[str, dict[str, object]] = {}
        self.took: dict[str, float] = {}

    def start(self, folder: Path, *arguments: object, room: int | None = None) -> Any:
        """A command as a process; files may not become larger than `room` bytes."""
        begin = ["-m", "deggflow.app.start"] if room is None else ["-c", LIMITED, str(room)]
        return subprocess.Popen(
            [sys.executable, *begin, *map(str, arguments)],
            cwd=folder,
            env=self.environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def run(self, folder: Path, *arguments: object) -> tuple[int, str]:
        """A command to its end: exit code, and what it said on stderr."""
        process = self.start(folder, *arguments)
        _, said = process.communicate(timeout=PATIENCE)
        return process.returncode, said

    def prepare(self, chosen: list[Job], say: Callable[[str], None]) -> None:
        """Runs everything once without faults."""
        from deggflow.tasks.tabletop.field import SHIPPED

        for ending in (".safetensors", ".json"):
            shutil.copy(SHIPPED.with_suffix(ending), self.given / f"w{ending}")
        for call in (
            ("tabletop", "data", "--training", 6, "--validation", 3, "--out", "td"),
            ("bridge", "data", "--training", 2, "--validation", 1, "--out", "bd"),
            ("tabletop", "generate", "--size", 3, "--count", 2, "--out", "s.jsonl"),
        ):
            if not any(call[-1] in job.needs for job in chosen):
                continue
            code, said = self.run(self.given, *call)
            assert code == 0, said
        for job in chosen:
            for name in ("cold", "warm"):  # the second time programs are compiled
                folder = self.folder(job, f"{name} {job.name}")
                start = time.monotonic()
                code, said = self.run(folder, *job.command)
                assert code in (0, 3), said
                self.took[job.name] = time.monotonic() - start
            self.known[job.name] = {each: job.compared(folder / each) for each in job.files}
            assert None not in self.known[job.name].values(), job.name
            say(f"{job.name}: {self.took[job.name]:.1f} s without faults")

    def folder(self, job: Job, name: str) -> Path:
        """A fresh folder with what a job reads."""
        folder = self.home / name.replace(" ", "-")
        folder.mkdir()
        for each in job.needs:
            source = self.given / each
            copy = shutil.copytree if source.is_dir() else shutil.copy
            copy(source, folder / each)
        return folder


def finished(job: Job, folder: Path) -> dict[str, bytes]:
    """The complete lines of a job's files."""
    found = {}
    for name in job.lines:
        path = folder / name
        content = path.read_bytes() if path.exists() else b""
        found[name] = content[: content.rfind(b"\n") + 1]
    return found
