"""What happens to a command that is running, and what it may do then."""

import ctypes
import fcntl
import os
import random
import re
import shutil
import signal
import termios
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .stage import PATIENCE, Job, Stage, finished

STOPPED = {-signal.SIGKILL, -signal.SIGINT, 130}


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


def _has_spoken(process: Any) -> bool:
    """Whether the command has printed its last words, which it does after its last look at its files."""
    waiting = ctypes.c_int()
    for pipe in (process.stdout, process.stderr):
        fcntl.ioctl(pipe, termios.FIONREAD, waiting)
        if waiting.value:
            return True
    return False


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


def _before_our_first_line(said: str) -> bool:
    """Whether Python itself was interrupted, which prints a traceback that no program can help."""
    files = re.findall(r'  File "([^"]*)"', said)
    # A line of a .pth file, which `site` runs, is a "<string>".
    return bool(files) and all(name.startswith(("<frozen ", "<string>")) for name in files)


def stopped(fault: Fault, sign: signal.Signals) -> tuple[int, str | None]:
    """Killed or interrupted at some moment."""
    process = fault.stage.start(fault.folder, *fault.job.command)
    fault.wait(process, fault.moment())
    if process.poll() is None:
        process.send_signal(sign)
    code, said = _ended(process)
    if _before_our_first_line(said):
        return code, None
    if "Traceback" in said:
        return code, f"a traceback: {said.strip()[-300:]!r}"
    fine = code in STOPPED or code in (0, 3)
    return code, None if fine else f"exit code {code}: {said[-300:]!r}"


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
    running = process.poll() is None and not _has_spoken(process)
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
    # Otherwise the command wrote a newer one, as `train` does with its curves.
    if path.exists() and path.read_bytes() == b"mine\n":
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
