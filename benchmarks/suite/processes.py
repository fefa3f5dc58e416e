"""What only a process of its own can tell: compile time cold and warm, memory, start-up."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from deggflow.blocks import padded_batch

from .clock import Patience, in_turn
from .rows import Row, Way, rows_of

# Prints seconds of the first call, those of the second, and the most memory used, in MB.
_GENERATE = """
import sys, time
from deggflow.app.session import prepare_jax
prepare_jax()
import numpy as np
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import tabletop_guidance
size, count = map(int, sys.argv[1:])
generator = TabletopGenerator(load_field(), tabletop_guidance())
conditions, noise = random_conditions(size, count, "changed", 0), initial_noise(0, np.arange(count), 0)
begin = time.perf_counter()
generator.batch(noise, conditions)
first = time.perf_counter() - begin
try:  # getrusage would tell of the parent, too, whose pages a new process shares at first
    with open("/proc/self/status") as status:
        peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
except OSError:
    import resource
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
print(first, peak)
"""
SIZE = 8  # objects of the scene whose program is compiled
CROWD = 4  # objects of the scenes whose memory is taken: memory per batch is what counts


def compiling(patience: Patience, quick: bool) -> Iterator[Row]:
    """The first scene of a process: its program compiled, or read from the cache that another process left."""
    with tempfile.TemporaryDirectory() as folder:
        cold, warm = (_generate(SIZE, 1, folder)[0] for _ in range(2))
    times = {"compile/cold": [cold], "compile/warm": [warm]}
    ways = {
        "compile/cold": Way(f"first guided scene of a process, N = {SIZE}, empty cache"),
        "compile/warm": Way(
            f"the same, N = {SIZE}, cache of an earlier process", 1, "compile/cold"
        ),
    }
    yield from rows_of(ways, times)


def memory(patience: Patience, quick: bool) -> Iterator[Row]:
    """The most memory that a process uses, by the number of its scenes."""
    first: Row | None = None
    counts = (1, 16) if quick else (512, 2048)
    for batch in sorted({padded_batch(count) for count in counts}):
        _generate(
            CROWD, batch, None
        )  # leaves the program in the cache: compiling takes more memory
    for count in counts:
        seconds, peak = _generate(CROWD, count, None)
        figures = {"MB": peak}
        if first is not None:
            figures["MB over the fewer"] = peak / first.figures["MB"]
        what = f"peak memory of a process that generates {count} guided scenes, N = {CROWD}"
        row = Row(
            f"memory/{count}",
            what,
            1000 * seconds,
            count,
            None,
            None,
            "",
            figures,
        )
        first = first or row
        yield row


def command(patience: Patience, quick: bool) -> Iterator[Row]:
    """The command a user types for ten thousand scenes, each with its certificate; programs compiled before."""
    for count in (1, 130) if quick else (512, 10_000):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "scenes.jsonl"
            given = [
                "tabletop",
                "generate",
                "--size",
                "8",
                "--count",
                str(count),
                "--out",
                str(out),
            ]
            call = [sys.executable, "-m", "deggflow.app.start", *given]
            begin = time.perf_counter()
            subprocess.run(call, capture_output=True, check=True)
            seconds = time.perf_counter() - begin
            held = out.read_text().count('"satisfied": true')
        name, what = f"command/{count}", " ".join(["deggflow", *given[:-2]])
        figures = {"s": seconds, "certified": float(held)}
        yield Row(name, what, 1000 * seconds, count, figures=figures)


def start_up(patience: Patience, quick: bool) -> Iterator[Row]:
    """How long the command takes to say what it can do."""
    calls = {
        "start/python": ["-c", "pass"],
        "start/help": ["-m", "deggflow.app.start", "--help"],
    }
    ways = {
        "start/python": Way("python, doing nothing"),
        "start/help": Way("deggflow --help", 1, "start/python"),
    }
    runs = {
        name: lambda given=given: subprocess.run(
            [sys.executable, *given], capture_output=True, check=True
        )
        for name, given in calls.items()
    }
    yield from rows_of(ways, in_turn(runs, Patience(patience.seconds, 3, 9)))


def _generate(size: int, count: int, cache: str | None) -> tuple[float, float]:
    """Seconds of the first call and MB, of a process that generates scenes."""
    environment = dict(os.environ)
    if cache is not None:
        environment["DEGGFLOW_CACHE"] = str(Path(cache))
    given = [sys.executable, "-c", _GENERATE, str(size), str(count)]
    out = subprocess.run(given, env=environment, capture_output=True, text=True, check=True)
    seconds, peak = map(float, out.stdout.split())
    return seconds, peak
