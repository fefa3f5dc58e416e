"""The benchmark suite: one table, and the same as JSON.

Usage: python benchmarks/run.py [--only scenes qp ...] [--quick] [--out benchmarks/results.json]
"""

import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from suite.clock import FULL, QUICK, Patience
from suite.rows import Row, table, write
from suite.speed import available_cores

from deggflow.app.session import prepare_jax

Subject = Callable[[Patience, bool], Iterator[Row]]
"""(how long, whether in small) -> rows."""

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Settings:
    """What is measured."""

    only: tuple[str, ...] = ()  # names of subjects; all of them if none is given
    quick: bool = False  # small batches and few rounds: to see that all of it runs
    out: Path = HERE / "results.json"


def subjects() -> dict[str, Subject]:
    """Everything that is measured, by name, in the order of the table."""
    from suite import (
        few,
        generation,
        joint,
        large_scenes,
        parts,
        plans,
        processes,
        qp,
        rounding,
        script,
        speed,
    )

    return {
        "scenes": generation.scenes,
        "policies": generation.policies,
        "plans": plans.plans,
        "few_evaluations": few.few_evaluations,
        "large_scenes": large_scenes.large_scenes,
        "parts": parts.parts,
        "speed": speed.speed,
        "compile": processes.compiling,
        "memory": processes.memory,
        "command": processes.command,
        "start": processes.start_up,
        "qp": qp.agents,
        "bfloat16": rounding.bfloat16,
        "script": script.script,
        "joint": joint.joint,
    }


def main(settings: Settings) -> None:
    prepare_jax()
    known = subjects()
    for name in settings.only:
        if name not in known:
            raise SystemExit(f"--only: {name!r} is none of {', '.join(known)}")
    patience = QUICK if settings.quick else FULL
    rows: list[Row] = []
    for name, subject in known.items():
        if settings.only and name not in settings.only:
            continue
        begin = time.perf_counter()
        rows += subject(patience, settings.quick)
        print(f"{name}: {time.perf_counter() - begin:.0f} s", flush=True)
        write(settings.out, about(settings), rows)  # what is there stays if the run is stopped
    print()
    print(table(rows))


def about(settings: Settings) -> dict[str, object]:
    """What the numbers depend on besides the code."""
    import jax

    return {
        "quick": settings.quick,
        "machine": platform.machine(),
        "cores": available_cores(),
        "python": platform.python_version(),
        "jax": jax.__version__,
    }


if __name__ == "__main__":
    main(tyro.cli(Settings))
