"""Real processes of every command that writes are killed, interrupted, robbed of their disk, folder, file and weights.

Whatever happens, afterwards the files are those of an uninterrupted run, or the command said in one line why not:
lines that were finished are still there, no two runs stand in one file, nothing prints a traceback.

Faults of one chain hit the same files one after the other; in the end the command is left to finish, and what it
wrote is compared, byte by byte, with what a run without faults wrote.

Run: python benchmarks/faults.py [--faults 1000] [--only "tabletop generate"] [--workers 2], half an hour on 2 cores
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CHAIN = 8  # faults that hit the same files
PATIENCE = 600.0  # s, for one process on a slow machine
LIMITED = """
import resource, sys

room = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
from deggflow.app.start import main

main()
"""  # files may not grow beyond some size: as on a full disk, a write fails in its middle
STOPPED = {-signal.SIGKILL, -signal.SIGINT, 130}


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


@dataclass
class Tally:
    """What faults did, by kind."""

    faults: Counter[str] = field(default_factory=Counter)
    refused: int = 0  # ended in one line and exit code 2
    problems: list[str] = field(default_factory=list)
    lock: Any = field(default_factory=threading.Lock)

    def add(self, kind: str, job: Job, seed: int, problem: str | None, *, refused: bool) -> None:
        """Counts one fault."""
        with self.lock:
            self.faults[kind] += 1
            self.refused += refused
            if problem is not None:
                self.problems.append(f"{job.name}, seed {seed}, {kind}: {problem}")
                print(self.problems[-1], file=sys.stderr, flush=True)


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
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def run(self, folder: Path, *arguments: object) -> tuple[int, str]:
        """A command to its end: exit code, and what it said on stderr."""
        process = self.start(folder, *arguments)
        _, said = process.communicate(timeout=PATIENCE)
        return process.returncode, said

    def prepare(self, chosen: list[Job], say: Callable[[str], None]) -> None:
        """Runs everything once without faults."""
        from deggflow.tasks.tabletop.field import shipped_weights

        for ending in (".safetensors", ".json"):
            shutil.copy(shipped_weights().with_suffix(ending), self.given / f"w{ending}")
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


@dataclass
class Fault:
    """One fault under way: what is checked after it."""

    stage: Stage
    job: Job
    folder: Path
    draw: random.Random

    def moment(self) -> float:
        """Some time of a run (s)."""
        return self.draw.uniform(0.0, 1.1 * self.stage.took[self.job.name])

    def wait(self, process: Any, until: float) -> None:
        """Until a moment, or the end of the process; half the time until something is written, and a little more."""
        end = time.monotonic() + until
        watch = self.draw.random() < 0.5
        path = self.folder / self.job.out
        before = path.stat().st_size if path.exists() else 0
        while time.monotonic() < end + (PATIENCE if watch else 0) and process.poll() is None:
            if watch and path.exists() and path.stat().st_size > before:
                time.sleep(self.draw.uniform(0.0, 0.05))
                return
            time.sleep(0.002)


def _ended(process: Any) -> tuple[int, str]:
    _, said = process.communicate(timeout=PATIENCE)
    return process.returncode, said


def _one_line(code: int, said: str) -> str | None:
    """What is wrong with how a command ended that may not have done its work."""
    if "Traceback" in said:
        return f"a traceback: {said.strip()[-300:]!r}"
    if code in (0, 3):
        return None
    lines = [line for line in said.splitlines() if line.startswith("deggflow: ")]
    if code != 2 or len(lines) != 1:
        return f"exit code {code}: {said.strip()[-300:]!r}"
    return None


def stopped(fault: Fault, sign: signal.Signals) -> tuple[int, str | None]:
    """Killed or interrupted at some moment."""
    process = fault.stage.start(fault.folder, *fault.job.command)
    fault.wait(process, fault.moment())
    if process.poll() is None:
        process.send_signal(sign)
    code, said = _ended(process)
    if "Traceback" in said:
        return code, f"a traceback: {said.strip()[-300:]!r}"
    return code, None if code in STOPPED or code in (0, 3) else f"exit code {code}: {said[-300:]!r}"


def kill(fault: Fault) -> tuple[int, str | None]:
    """Killed at some moment."""
    return stopped(fault, signal.SIGKILL)


def interrupt(fault: Fault) -> tuple[int, str | None]:
    """Ctrl-C at some moment."""
    return stopped(fault, signal.SIGINT)


def full(fault: Fault) -> tuple[int, str | None]:
    """No file may grow beyond some size: a write in the middle of a line or a checkpoint fails."""
    sizes = [len(v) for v in fault.stage.known[fault.job.name].values() if isinstance(v, bytes)]
    room = fault.draw.randrange(max(sizes, default=20_000))
    process = fault.stage.start(fault.folder, *fault.job.command, room=room)
    code, said = _ended(process)
    return code, _one_line(code, said)


def removed(fault: Fault) -> tuple[int, str | None]:
    """The output's folder goes; nobody may say that the results are in it."""
    process = fault.stage.start(fault.folder, *fault.job.command)
    fault.wait(process, fault.moment())
    running = process.poll() is None
    gone = fault.folder / "o"
    for _ in range(100):  # files may be put into it meanwhile
        shutil.rmtree(gone, ignore_errors=True)
        if not gone.exists():
            break
    code, said = _ended(process)
    if running and code in (0, 3):
        missing = [name for name in fault.job.files if not (fault.folder / name).exists()]
        if missing and fault.job.lines:
            return code, f"exit code {code}, and {missing[0]} does not exist"
    return code, _one_line(code, said)


def replaced(fault: Fault) -> tuple[int, str | None]:
    """The output is another file all of a sudden, which stays as it is."""
    process = fault.stage.start(fault.folder, *fault.job.command)
    fault.wait(process, fault.moment())
    path = fault.folder / fault.job.out
    if process.poll() is not None or not path.exists():
        return stopped_later(process)
    kept, foreign = fault.folder / "kept", fault.folder / "foreign"
    foreign.write_bytes(b"mine\n")
    shutil.copy(path, kept)
    os.replace(foreign, path)
    code, said = _ended(process)
    problem = _one_line(code, said)
    if path.read_bytes() != b"mine\n" and fault.job.lines:
        problem = "wrote into a file that is not its own"
    if code in (0, 3) and path.read_bytes() == b"mine\n" and fault.job.lines:
        whole_before = kept.read_bytes() == fault.stage.known[fault.job.name][fault.job.out]
        if not whole_before:
            problem = f"exit code {code}, and its lines are nowhere"
    os.replace(kept, path)
    return code, problem


def stopped_later(process: Any) -> tuple[int, str | None]:
    """Nothing to be replaced yet: killed instead."""
    process.kill()
    code, _ = _ended(process)
    return code, None


def two_writers(fault: Fault) -> tuple[int, str | None]:
    """The same command twice at a time."""
    first = fault.stage.start(fault.folder, *fault.job.command)
    time.sleep(fault.draw.uniform(0, 0.5))
    second = fault.stage.start(fault.folder, *fault.job.command)
    ends = [_ended(first), _ended(second)]
    problems = [_one_line(code, said) for code, said in ends]
    if all(code == 2 for code, _ in ends):
        problems.append(f"neither ran: {ends[0][1][-200:]!r}")
    return max(code for code, _ in ends), next((p for p in problems if p), None)


def other_arguments(fault: Fault) -> tuple[int, str | None]:
    """Another run's arguments are refused, once there is something to be mixed up."""
    before = finished(fault.job, fault.folder)
    there = any(before.values()) or (fault.folder / "o" / "config.json").exists()
    if not fault.job.other or not there:
        return kill(fault)
    code, said = fault.stage.run(fault.folder, *fault.job.command, *fault.job.other)
    problem = _one_line(code, said)
    if code != 2:
        problem = f"exit code {code} for another run in the same files"
    if finished(fault.job, fault.folder) != before:
        problem = "files were changed by another run"
    return code, problem


def other_weights(fault: Fault) -> tuple[int, str | None]:
    """The weights are replaced by others of the same name between two calls."""
    before = finished(fault.job, fault.folder)
    path = fault.folder / "w.safetensors"
    if not path.exists() or not any(before.values()):
        return kill(fault)
    good = path.read_bytes()
    from safetensors.numpy import load, save

    path.write_bytes(save({name: 1.01 * array for name, array in load(good).items()}))
    code, said = fault.stage.run(fault.folder, *fault.job.command)
    problem = _one_line(code, said)
    if code != 2 or finished(fault.job, fault.folder) != before:
        problem = f"exit code {code} with other weights"
    path.write_bytes(good)
    return code, problem


FAULTS: dict[str, tuple[Callable[[Fault], tuple[int, str | None]], float]] = {
    "killed": (kill, 5),
    "interrupted": (interrupt, 2),
    "disk full": (full, 3),
    "folder removed": (removed, 1),
    "file replaced": (replaced, 1),
    "two writers": (two_writers, 0.5),
    "other arguments": (other_arguments, 1),
    "other weights": (other_weights, 1),
}


def chain(
    stage: Stage, job: Job, seed: int, count: int, tally: Tally, only: str | None = None
) -> None:
    """Some faults on the same files, of one kind or any, then a run to the end."""
    draw = random.Random(f"{job.name} {seed}")
    folder = stage.folder(job, f"{job.name} {seed}")
    names, weights = list(FAULTS), [weight for _, weight in FAULTS.values()]
    for _ in range(count):
        kind = only or draw.choices(names, weights)[0]
        before = finished(job, folder)
        code, problem = FAULTS[kind][0](Fault(stage, job, folder, draw))
        after = finished(job, folder)
        for name, lines in after.items():
            known = stage.known[job.name][name]
            if problem is None and isinstance(known, bytes) and not known.startswith(lines):
                problem = f"{name} holds other lines than an uninterrupted run"
            if problem is None and kind != "folder removed" and len(lines) < len(before[name]):
                problem = f"{name} lost {len(before[name]) - len(lines)} bytes of finished lines"
        tally.add(kind, job, seed, problem, refused=code == 2)
    code, said = stage.run(folder, *job.command)
    found = {name: job.compared(folder / name) for name in job.files}
    unlike = [name for name in job.files if found[name] != stage.known[job.name][name]]
    problem = f"{unlike[0]} is not that of an uninterrupted run" if unlike else None
    if code not in (0, 3) or "Traceback" in said:
        problem = f"does not complete: exit code {code}: {said.strip()[-300:]!r}"
    if problem is None:
        shutil.rmtree(folder)
        return
    with tally.lock:
        tally.problems.append(f"{job.name}, seed {seed}, at the end: {problem}")
        print(tally.problems[-1], file=sys.stderr, flush=True)


def plan(chosen: list[Job], faults: int) -> Iterator[tuple[Job, int, int]]:
    """(job, seed, faults) of every chain, the jobs in turn."""
    whole_share = sum(job.share for job in chosen)
    left = {job.name: max(1, round(faults * job.share / whole_share)) for job in chosen}
    seed = 0
    while any(left.values()):
        for job in chosen:
            count = min(CHAIN, left[job.name])
            if count:
                yield job, seed, count
                left[job.name] -= count
        seed += 1


def run(
    home: Path, chosen: list[Job], faults: int, workers: int, say: Callable[[str], None]
) -> Tally:
    """Everything; what became of it."""
    stage, tally = Stage(home), Tally()
    stage.prepare(chosen, say)
    begun = time.monotonic()
    with ThreadPoolExecutor(workers) as pool:
        waiting = [
            pool.submit(chain, stage, job, seed, count, tally)
            for job, seed, count in plan(chosen, faults)
        ]
        try:
            for each in waiting:
                each.result()
                done, took = sum(tally.faults.values()), time.monotonic() - begun
                say(f"{done} faults, {len(tally.problems)} problems, {took:.0f} s")
        except KeyboardInterrupt:  # chains under way are finished, and all is told
            pool.shutdown(cancel_futures=True)
    return tally


def main() -> int:
    """Prints what became of the faults; 1 where something was lost, mixed, or said in a traceback."""
    parser = argparse.ArgumentParser(description="Faults in the middle of commands that write.")
    parser.add_argument("--faults", type=int, default=1000)
    parser.add_argument("--only", help="commands whose name holds this text")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    given = parser.parse_args()
    chosen = [job for job in jobs() if not given.only or given.only in job.name]
    with tempfile.TemporaryDirectory() as home:
        tally = run(
            Path(home), chosen, given.faults, given.workers,
            lambda text: print(text, file=sys.stderr, flush=True),
        )  # fmt: skip
    for kind, count in tally.faults.items():
        print(f"{kind:16} {count:6,}")
    total = sum(tally.faults.values())
    print(f"{total:,} faults in {len(chosen)} commands, {tally.refused:,} refused in one line; "
          f"{len(tally.problems)} problems")  # fmt: skip
    print("\n".join(tally.problems[:40]))
    return 1 if tally.problems else 0


if __name__ == "__main__":
    sys.exit(main())
