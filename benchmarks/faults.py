"""Real processes of every command that writes are killed, interrupted, robbed of their disk, folder, file and weights.

Whatever happens, afterwards the files are those of an uninterrupted run, or the command said in one line why not:
lines that were finished are still there, no two runs stand in one file, nothing prints a traceback.

Faults of one chain hit the same files one after the other; in the end the command is left to finish, and what it
wrote is compared, byte by byte, with what a run without faults wrote.

Run: python benchmarks/faults.py [--faults 1000] [--only "tabletop generate"] [--seed 0] [--workers 2], half an hour on 2 cores
"""

import argparse
import random
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from faulting.kinds import FAULTS, Fault
from faulting.stage import Job, Stage, finished, jobs

CHAIN = 8  # faults that hit the same files


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


def plan(chosen: list[Job], faults: int, seed: int) -> Iterator[tuple[Job, int, int]]:
    """(job, seed, faults) of every chain, the jobs in turn, seeds from the given one on."""
    whole_share = sum(job.share for job in chosen)
    left = {job.name: max(1, round(faults * job.share / whole_share)) for job in chosen}
    while any(left.values()):
        for job in chosen:
            count = min(CHAIN, left[job.name])
            if count:
                yield job, seed, count
                left[job.name] -= count
        seed += 1


def run(
    home: Path,
    chosen: list[Job],
    faults: int,
    workers: int,
    say: Callable[[str], None],
    seed: int = 0,
) -> Tally:
    """Everything; what became of it."""
    stage, tally = Stage(home), Tally()
    stage.prepare(chosen, say)
    begun = time.monotonic()
    with ThreadPoolExecutor(workers) as pool:
        waiting = [
            pool.submit(chain, stage, job, seed, count, tally)
            for job, seed, count in plan(chosen, faults, seed)
        ]
        try:
            for each in as_completed(waiting):
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
    parser.add_argument("--seed", type=int, default=0, help="of the first chain of each command")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    given = parser.parse_args()
    chosen = [job for job in jobs() if not given.only or given.only in job.name]
    with tempfile.TemporaryDirectory() as home:
        tally = run(
            Path(home), chosen, given.faults, given.workers,
            lambda text: print(text, file=sys.stderr, flush=True), given.seed,
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
