"""Conditions whose first draw fails: which requirement by how much, and whether other ways show that they are feasible.

Usage: python benchmarks/fleet_feasibility.py [--maps dense] [--scheme random] [--sizes 9 15] [--cases 200] [--seeds 1 2]

Of each such condition: further draws, the planner of the demonstrations, and, where neither finds a plan, prioritised
planning with the same denoiser. Any of their plans that the exact verdict accepts and Shapely does not refute proves that
the condition is feasible; that there is none does not prove the contrary.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro

from deggflow.app.session import prepare_jax
from deggflow.statistics import Rate

CELLS = (
    "map", "starts", "N", "first draws that fail", "feasible", "by further draws", "by the planner", "else by prioritised planning",
    "misses at the first draw",
)  # fmt: skip
FAILED = (
    "map", "N", "seed", "case", "requirement", "missed by", "robots blocked", "length of its way, of its reach", "draws",
    "teams", "orders",
)  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """What is looked at."""

    maps: tuple[str, ...] = ("dense",)
    scheme: str = "random"
    sizes: tuple[int, ...] = (9, 15)
    cases: int = 200  # of each map, size and seed
    seeds: tuple[int, ...] = (1, 2)
    draws: int = 32  # further ones
    teams: int = 4  # that the planner makes of a condition
    orders: int = 2  # of robots, in prioritised planning: their own, then random ones
    samples: int = 8  # paths that a robot draws at once in prioritised planning
    weights: Path | None = None


class Failure(NamedTuple):
    """A condition whose first draw failed.

    Attributes:
        seed: Of the run.
        number: Of the case in the run.
        miss: The least margin of the first draw.
        blocked: Number of robots that miss anything.
        tightness: Length of a short way of the robot with the least margin, over what its speed limit allows.
        draws: Of the first one that succeeds; None if there is none.
        teams: Of the planner until one succeeds; None if there is none.
        orders: Of robots until prioritised planning succeeds; None if there is none, or it was not needed.
    """

    seed: int
    number: int
    miss: Any
    blocked: int
    tightness: float
    draws: int | None
    teams: int | None
    orders: int | None

    @property
    def feasible(self) -> bool:
        """Whether a plan that satisfies every requirement is known."""
        return (self.draws, self.teams, self.orders) != (None, None, None)


class Ways:
    """The ways by which a condition is shown to be feasible."""

    def __init__(self, settings: Settings, field: Any) -> None:
        from deggflow.tasks.fleet.generator import FleetGenerator
        from deggflow.tasks.fleet.options import FleetFieldOptions
        from deggflow.tasks.fleet.prioritised import denoiser

        self.settings = settings
        self.generator = FleetGenerator(field, FleetFieldOptions())
        self.program = denoiser(field)

    def failures(self, conditions: Sequence[Any], seed: int) -> list[Failure]:
        """Of all conditions of a seed."""
        first: dict[int, Any] = {}
        plans = self.generator.plans(
            conditions,
            seed=seed,
            max_draws=1 + self.settings.draws,
            on_draw=lambda number, plan: first.setdefault(number, plan),
        )
        out = []
        for number, plan in enumerate(plans):
            verdict = first[number].verdict()
            if verdict.satisfied:
                continue
            condition, good = plan.condition, accepted(plan.condition, plan.paths)
            teams = self._planned(condition, seed, number)
            known = good or teams is not None
            orders = None if known else self._prioritised(condition, seed, number)
            out.append(
                Failure(
                    seed,
                    number,
                    verdict.worst,
                    len(verdict.blocked),
                    tightness(condition, verdict.worst.robot, seed),
                    plan.certificate.draws if good else None,
                    teams,
                    orders,
                )
            )
        return out

    def _planned(self, condition: Any, seed: int, number: int) -> int | None:
        from deggflow.tasks.fleet.planner import demonstrate

        rng = np.random.default_rng([seed, number, 1])
        teams = (demonstrate(condition, rng).paths for _ in range(self.settings.teams))
        return first_good(condition, teams)

    def _prioritised(self, condition: Any, seed: int, number: int) -> int | None:
        """In the robots' order, then in random ones."""
        from dataclasses import replace

        from deggflow.tasks.fleet.paths import DIM
        from deggflow.tasks.fleet.prioritised import prioritised

        rng, robots = np.random.default_rng([seed, number, 2]), len(condition.robots)

        def plan(turn: int) -> np.ndarray:
            order = np.arange(robots) if turn == 0 else rng.permutation(robots)
            noise = rng.normal(size=(robots, self.settings.samples, DIM)).astype(np.float32)
            turned = replace(condition, robots=tuple(condition.robots[k] for k in order))
            return prioritised(self.program, turned, noise).paths[np.argsort(order)]

        return first_good(condition, map(plan, range(self.settings.orders)))


def accepted(condition: Any, paths: np.ndarray) -> bool:
    """Whether the exact verdict accepts a plan, and Shapely does not refute it."""
    from deggflow.tasks.fleet.oracle import refutes
    from deggflow.tasks.fleet.verdict import judge

    return judge([condition], [paths])[0].satisfied and not refutes(condition, paths)


def first_good(condition: Any, plans: Any) -> int | None:
    """Number, from 1, of the first plan that is accepted."""
    numbered = enumerate(plans, start=1)
    return next((number for number, paths in numbered if accepted(condition, paths)), None)


def tightness(condition: Any, robot: int, seed: int, ways: int = 24) -> float:
    """Least length of some short ways of a robot around the obstacles, over what the speed limit allows in all steps."""
    from deggflow.tasks.fleet.routes import Search, routes

    (paths,) = routes([Search(condition, np.array([robot]), np.random.default_rng(seed))], ways)
    paths = paths[:, 0]
    steps = np.linalg.norm(np.diff(paths, axis=1), axis=-1)
    return float(steps.sum(-1).min() / (steps.shape[1] * condition.speed_limit))


def print_row(cells: Sequence[str]) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def print_cell(settings: Settings, name: str, size: int, failures: Sequence[Failure]) -> None:
    kinds = Counter(failure.miss.kind for failure in failures)
    missed = ", ".join(
        f"{kind} {count} (by {_range([-f.miss.margin for f in failures if f.miss.kind == kind])})"
        for kind, count in sorted(kinds.items())
    )
    counts = [
        sum(getattr(failure, way) is not None for failure in failures)
        for way in ("draws", "teams", "orders")
    ]
    total = len(settings.seeds) * settings.cases
    print_row(
        (
            name, settings.scheme, str(size), f"{len(failures)} of {total}: {Rate(len(failures), total)}",
            f"{sum(f.feasible for f in failures)} of {len(failures)}", *map(str, counts), missed or "-",
        )
    )  # fmt: skip


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.2g}" if len(values) == 1 else f"{min(values):.2g} to {max(values):.2g}"


def print_failure(name: str, size: int, failure: Failure) -> None:
    proofs = ("-" if number is None else str(number) for number in failure[-3:])
    print_row(
        (
            name, str(size), str(failure.seed), str(failure.number + 1), failure.miss.kind, f"{-failure.miss.margin:.2g}",
            str(failure.blocked), f"{failure.tightness:.2f}", *proofs,
        )
    )  # fmt: skip


def main(settings: Settings) -> None:
    prepare_jax()
    from deggflow.tasks.fleet.drawn import random_conditions
    from deggflow.tasks.fleet.field import load_field

    ways, failures = Ways(settings, load_field(settings.weights)), {}
    for row in (CELLS, ["---"] * len(CELLS)):
        print_row(row)
    for cell in itertools.product(settings.maps, settings.sizes):
        name, size = cell
        failures[cell] = []
        for seed in settings.seeds:
            conditions = random_conditions(size, settings.cases, name, settings.scheme, seed)  # type: ignore[arg-type]
            failures[cell] += ways.failures(conditions, seed)
        print_cell(settings, *cell, failures[cell])
    print()
    for row in (FAILED, ["---"] * len(FAILED)):
        print_row(row)
    for cell, each in failures.items():
        for failure in each:
            print_failure(*cell, failure)
    print(
        f"\nSeeds {', '.join(map(str, settings.seeds))}, {settings.cases} cases of each; lengths in map units, 95% Wilson "
        f"intervals. Up to {settings.draws} further draws, {settings.teams} teams of the planner, and, without success of these, "
        f"{settings.orders} orders of prioritised planning; the last three columns say which one was the first that the exact "
        "verdict accepts. Reach: what the speed limit allows in all steps; the way is the shortest of some on a roadmap "
        "without the other robots."
    )


if __name__ == "__main__":
    main(tyro.cli(Settings))
