"""The fleet's nominal field without guidance: success, clearance, skills of the maps, distance to demonstrations.

Usage: python benchmarks/fleet_nominal.py [--sizes 3 6 9] [--cases 16] [--evaluations 16]
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from deggflow.app.session import prepare_jax

CLOSE, LEAST = (
    0.06,
    12,
)  # map units and waypoints of 64: a robot waits where so many are so near to a waiting point
BACKWARDS = 0.6  # rad, largest clockwise turn on highways that counts as counter-clockwise


@dataclass(frozen=True)
class Settings:
    """What is measured."""

    sizes: tuple[int, ...] = (3, 6, 9)
    maps: tuple[str, ...] = ("empty", "conveyor", "highways", "drop_region", "dense", "random")
    cases: int = 16  # of each map, scheme and size
    evaluations: int = 16
    seed: int = 5
    weights: Path | None = None


def shows_skill(name: str, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> bool | None:
    """Whether a path has the skill of its map; None where a map has none."""
    from deggflow.tasks.fleet.maps import WAITING_POINTS

    if name == "conveyor":  # through the corridor that leads to the side of the goal
        step = np.nonzero((path[1:, 0] > 0) != (path[:-1, 0] > 0))[0]
        right = path[step + 1, 0] > path[step, 0]
        height = (path[step, 1] + path[step + 1, 1]) / 2 * np.where(right, -1, 1)
        across = goal[0] - start[0]
        wanted = np.full(len(step), True) if abs(across) < 1e-6 else right == (across > 0)
        return bool(np.any(wanted & (height > 0.05) & (height < 0.3)))
    if name == "drop_region":
        away = np.linalg.norm(path[:, None] - np.array(WAITING_POINTS), axis=-1)
        return bool((away < CLOSE).sum(0).max() >= LEAST)
    if name == "highways":
        angle = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
        return bool(angle[-1] - angle[0] > -BACKWARDS)
    return None


def row(settings: Settings, generator: Any, name: str, scheme: Any, size: int) -> Sequence[str]:
    from deggflow.tasks.fleet.choice import least_distance
    from deggflow.tasks.fleet.clearance import clearance, within
    from deggflow.tasks.fleet.condition import APART, padding
    from deggflow.tasks.fleet.drawn import random_conditions
    from deggflow.tasks.fleet.generator import initial_noise
    from deggflow.tasks.fleet.planner import candidates
    from deggflow.tasks.fleet.verdict import judge

    conditions = random_conditions(size, settings.cases, name, scheme, settings.seed)  # type: ignore[arg-type]
    numbers, agents = np.arange(settings.cases), padding(conditions).agents
    batch = generator.batch(initial_noise(settings.seed, numbers, 0, agents, 1), conditions)
    team = [verdict.satisfied for verdict in judge(conditions, batch.paths)]
    apart, clear, near, skill, off = [], [], [], [], []
    for condition, paths in zip(conditions, batch.paths, strict=True):
        apart.append(least_distance(paths) >= APART * condition.radius)
        between = (paths[:, 1:] + paths[:, :-1]) / 2
        points = np.concatenate([paths, between], axis=1)
        gap = clearance(condition.floor, points).min(1)
        inside = within(condition.floor, points, condition.radius).all(1)
        clear += list((gap >= condition.radius) & inside)
        near += list(gap >= 0.0)
        ends = zip(paths, condition.starts, condition.goals, strict=True)
        skill += [shows_skill(name, path, start, goal) for path, start, goal in ends]
        planned = candidates(condition, np.random.default_rng(settings.seed))[0]
        square = np.mean(np.sum((planned - paths[:, None]) ** 2, axis=-1), axis=-1)
        off += list(np.sqrt(square.min(1)))
    shown = "-" if skill[0] is None else f"{np.mean(np.array(skill, float)):.0%}"
    return (
        name, str(size), scheme, f"{np.mean(team):.0%}", f"{np.mean(apart):.0%}", f"{np.mean(clear):.0%}",
        f"{np.mean(near):.0%}", shown, f"{np.median(off):.3f}",
    )  # fmt: skip


def main(settings: Settings) -> None:
    prepare_jax()
    from deggflow.tasks.fleet.field import load_field
    from deggflow.tasks.fleet.generator import FleetGenerator
    from deggflow.tasks.fleet.options import FleetFieldOptions
    from deggflow.tasks.fleet.schemes import OWN

    options = FleetFieldOptions(evaluations=settings.evaluations)
    generator = FleetGenerator(load_field(settings.weights), options, guided=False)
    head = (
        "map", "N", "starts, goals", "plans satisfied", "all apart", "robots clear", "centres outside obstacles",
        "robots with the map's skill", "RMS to the nearest of 20 planned paths, median",
    )  # fmt: skip
    for each in (head, ["---"] * len(head)):
        print("| " + " | ".join(each) + " |", flush=True)
    for name in settings.maps:
        for size in settings.sizes:
            for scheme in ("own", "random") if name in OWN else ("random",):
                cells = row(settings, generator, name, scheme, size)
                print("| " + " | ".join(cells) + " |", flush=True)
    print(
        f"\n{settings.cases} cases a row, seed {settings.seed}, {settings.evaluations} evaluations."
    )


if __name__ == "__main__":
    main(tyro.cli(Settings))
