"""Certified scenes and plans on the device that JAX uses, by the size of a block; docs/performance.md has those of a GPU.

Usage: python benchmarks/accelerator.py [--scenes 10000] [--plans 512] [--blocks 64 512] [--rounds 3]
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
import tyro

from deggflow import blocks
from deggflow.app.session import prepare_jax
from deggflow.tasks.fleet.drawn import random_conditions as random_plans
from deggflow.tasks.fleet.field import load_field as load_fleet
from deggflow.tasks.fleet.generator import FleetGenerator
from deggflow.tasks.fleet.maps import NAMED
from deggflow.tasks.fleet.options import FleetFieldOptions
from deggflow.tasks.tabletop.changes import random_conditions as random_scenes
from deggflow.tasks.tabletop.condition import to_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import tabletop_guidance

OBJECTS, ROBOTS, SEED = 8, 9, 1


@dataclass(frozen=True)
class Settings:
    """What is measured."""

    scenes: int = 10_000
    plans: int = 512
    blocks: tuple[int, ...] = (64, 512)  # samples that the device gets at once
    rounds: int = 3  # after the first call, which compiles


def main(settings: Settings) -> None:
    prepare_jax()
    print(f"JAX {jax.__version__} on {jax.devices()[0].device_kind}", flush=True)
    print(
        "| what | block | first call (s) | then, a sample (ms) | satisfied |\n|---|---|---|---|---|"
    )
    conditions = random_scenes(OBJECTS, settings.scenes, "changed", SEED)
    scenes = TabletopGenerator(load_field(), tabletop_guidance())
    nominal = TabletopGenerator(load_field())
    noise = initial_noise(SEED, np.arange(settings.scenes), 0)[:, :OBJECTS]
    arrays = to_arrays(conditions, OBJECTS)
    plans = FleetGenerator(load_fleet(), FleetFieldOptions())
    for size in settings.blocks:
        blocks.BLOCK = blocks.ACCELERATOR_BLOCK = size
        for name, generator in (("nominal states", nominal), ("guided states", scenes)):
            call: Callable[[], Any] = partial(generator.draw, noise, arrays)
            _row(f"{settings.scenes:,} {name}", settings, size, call, settings.scenes)
        call = partial(scenes.scenes, conditions, seed=SEED)
        _row(f"{settings.scenes:,} certified scenes", settings, size, call, settings.scenes)
        for floor in NAMED:
            floors = random_plans(ROBOTS, settings.plans, floor, "random", SEED)  # type: ignore[arg-type]
            call = partial(plans.plans, floors, seed=SEED)
            _row(f"{settings.plans} plans, {floor}", settings, size, call, settings.plans)
    _row("one scene", settings, 1, partial(scenes.scenes, conditions[:1], seed=SEED), 1)
    _row("one plan, dense", settings, 1, partial(plans.plans, floors[:1], seed=SEED), 1)


def _row(what: str, settings: Settings, block: int, call: Callable[[], Any], samples: int) -> None:
    times, results = [], None
    for _ in range(settings.rounds + 1):
        begin = time.perf_counter()
        results = call()
        times.append(time.perf_counter() - begin)
    later = 1e3 * min(times[1:]) / samples
    print(
        f"| {what} | {block} | {times[0]:.1f} | {later:.3g} | {_satisfied(results)} |", flush=True
    )


def _satisfied(results: Any) -> str:
    if not isinstance(results, Sequence) or not hasattr(results[0], "certificate"):
        return "-"
    return f"{sum(each.certificate.satisfied for each in results):,} of {len(results):,}"


if __name__ == "__main__":
    main(tyro.cli(Settings))
