"""The fleet's plans on the maps of MRMP and MMD beside what was measured of their own code.

Usage: python benchmarks/fleet_published.py [--dense 6 9 15] [--mmd 6] [--cases 200] [--seeds 1 2] [--timed 20]

Dense is MRMP's map, with random starts and goals; the other four are MMD's, with MMD's own. Rows of others are marked: few
trials of the authors' own code, with a mixture of Gaussians as the denoiser, and each method's own check.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from fleet_baselines import ELSEWHERE

from deggflow.app.session import prepare_jax
from deggflow.statistics import Rate

TOLERANCE = 1e-3  # squared map units, of MRMP's check
HEAD = (
    "map", "N", "plans", "solved, exact verdict", "of each seed", "pass MRMP's check", "CPU a plan",
)  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """What is measured."""

    dense: tuple[int, ...] = (6, 9, 15)  # numbers of robots on MRMP's map
    mmd: tuple[int, ...] = (6,)  # numbers of robots on MMD's four maps
    cases: int = 200  # of each row and seed; with MMD's starts and goals they differ in z(0) alone
    seeds: tuple[int, ...] = (1, 2)
    max_draws: int = 16
    timed: int = 20  # plans of each row that are made alone, for their time
    weights: Path | None = None


def passes_mrmp(condition: Any, paths: np.ndarray) -> bool:
    """MRMP's own check (RAISELab-atUVA/Diffusion-MRMP, is_collision.py), written anew.

    Squared distances at waypoints alone, with a tolerance, of discs from each other and from disc obstacles; no bounds and
    no speed limit. Boxes, which its maps do not have, are measured alike.
    """
    radius, floor = condition.radius, condition.floor
    for x, y, size in floor.discs:
        if (np.sum((paths - (x, y)) ** 2, axis=-1) < (radius + size) ** 2 - TOLERANCE).any():
            return False
    for x, y, width, height in floor.boxes:
        beyond = np.maximum(np.abs(paths - (x, y)) - np.array([width, height]) / 2, 0.0)
        if (np.sum(beyond**2, axis=-1) < radius**2 - TOLERANCE).any():
            return False
    first, second = np.triu_indices(len(paths), 1)
    square = np.sum((paths[first] - paths[second]) ** 2, axis=-1)
    return not (square < (2 * radius) ** 2 - TOLERANCE).any()


class Ways:
    """Nominal plans, first draws and plans within several draws."""

    def __init__(self, settings: Settings, field: Any) -> None:
        from deggflow.tasks.fleet.generator import FleetGenerator
        from deggflow.tasks.fleet.options import FleetFieldOptions

        options = FleetFieldOptions()
        self.settings = settings
        self.guided = FleetGenerator(field, options)
        self.nominal = FleetGenerator(field, options, guided=False)

    def rows(self, name: str, scheme: Any, size: int) -> list[Sequence[str]]:
        """One row for each."""
        from deggflow.tasks.fleet.drawn import random_conditions

        settings = self.settings
        draws, several = settings.max_draws, f"ours, <= {settings.max_draws} draws"
        plans: dict[str, list[list[Any]]] = {"nominal": [], "ours, first draw": [], several: []}
        for seed in settings.seeds:
            conditions = random_conditions(size, settings.cases, name, scheme, seed)  # type: ignore[arg-type]
            plans["nominal"].append(self.nominal.plans(conditions, seed=seed))
            first, last = self._guided(conditions, seed)
            plans["ours, first draw"].append(first)
            plans[several].append(last)
        seconds = {
            "nominal": self._alone(self.nominal, plans["nominal"][0], 1),
            "ours, first draw": self._alone(self.guided, plans["nominal"][0], 1),
            several: self._alone(self.guided, plans["nominal"][0], draws),
        }
        return [
            (name, str(size), way, *_cells(each), f"{1e3 * seconds[way]:.0f} ms")
            for way, each in plans.items()
        ]

    def _guided(self, conditions: Sequence[Any], seed: int) -> tuple[list[Any], list[Any]]:
        """First draws, and plans within the limit of draws."""
        first: dict[int, Any] = {}
        last = self.guided.plans(
            conditions,
            seed=seed,
            max_draws=self.settings.max_draws,
            on_draw=lambda number, plan: first.setdefault(number, plan),
        )
        return [first[number] for number in range(len(conditions))], last

    def _alone(self, generator: Any, plans: Sequence[Any], max_draws: int) -> float:
        """Median of the seconds of CPU that a plan takes in a batch of one."""
        conditions, seed = [plan.condition for plan in plans], self.settings.seeds[0]
        generator.plans(conditions[:1], seed=seed, max_draws=max_draws)  # compiles
        seconds = []
        for number, condition in enumerate(conditions[: self.settings.timed]):
            start = time.process_time()
            generator.plans([condition], seed=seed, first=number, max_draws=max_draws)
            seconds.append(time.process_time() - start)
        return float(np.median(seconds))


def _cells(of_seeds: Sequence[Sequence[Any]]) -> tuple[str, str, str]:
    """Solved in all, of each seed, and plans that pass MRMP's check."""
    solved = [sum(plan.certificate.satisfied for plan in plans) for plans in of_seeds]
    everything = [plan for plans in of_seeds for plan in plans]
    passed = sum(passes_mrmp(plan.condition, plan.paths) for plan in everything)
    total = len(everything)
    counts = ", ".join(
        f"{count}/{len(plans)}" for count, plans in zip(solved, of_seeds, strict=True)
    )
    return str(Rate(sum(solved), total)), counts, str(Rate(passed, total))


def theirs(name: str, size: int) -> list[Sequence[str]]:
    """What was measured of others' own code on this map with so many robots."""
    rows = []
    for of_map, robots, way, solved, cpu in ELSEWHERE:
        if (of_map, robots) == (name, size):
            rate = Rate(*(int(count) for count in solved.split("/")))
            row = (f"theirs: {way}", "-", solved, f"{rate}, own check", cpu)
            rows.append((name, str(size), *row))
    return rows


def main(settings: Settings) -> None:
    prepare_jax()
    from deggflow.tasks.fleet.field import load_field
    from deggflow.tasks.fleet.schemes import OWN

    ways = Ways(settings, load_field(settings.weights))
    cells = [("dense", "random", size) for size in settings.dense]
    cells += [(name, "own", size) for size in settings.mmd for name in OWN]
    for row in (HEAD, ["---"] * len(HEAD)):
        print("| " + " | ".join(row) + " |", flush=True)
    for name, scheme, size in cells:
        for row in [*ways.rows(name, scheme, size), *theirs(name, size)]:
            print("| " + " | ".join(row) + " |", flush=True)
    print(
        f"\n{settings.cases} cases a row and seed, seeds {', '.join(map(str, settings.seeds))}; 95% Wilson intervals. solved: by "
        "the exact verdict at all times, bounds and speed limit included. MRMP's check: at waypoints alone, squared distances "
        f"to {TOLERANCE:g}, no bounds, no speed limit. CPU: process time of all threads, compiled, median of "
        f"{min(settings.timed, settings.cases)} plans made one by one. Rows marked theirs: the authors' own code, elsewhere, a "
        "few trials each, their own checks, no speed limit (yoraish/mmd; RAISELab-atUVA/Diffusion-MRMP)."
    )


if __name__ == "__main__":
    main(tyro.cli(Settings))
