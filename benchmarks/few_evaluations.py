"""What few evaluations of the field cost and spoil: guided scenes with an extrapolated drift beside those of 100 steps.

Usage: python benchmarks/few_evaluations.py [--sizes 8 12] [--evaluations 4 8 16] [--cases 256] [--rounds 3] [--order 2]
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tyro

from deggflow.app.session import prepare_jax


@dataclass(frozen=True)
class Settings:
    """What is compared."""

    sizes: tuple[int, ...] = (8, 12)  # objects of a scene
    evaluations: tuple[int, ...] = (4, 8, 16)  # of the field, in a generation
    order: int = 2  # of the extrapolation
    power: float = 1.5  # of the macro grid
    steps: int = 128  # of guidance, where the drift is extrapolated
    cases: int = 256
    rounds: int = 3  # of timing
    seed: int = 1


HEAD = (
    "N", "field evaluations", "guided, first draw", "hypotheses hold", "deviation", "nominal, default", "nominal's error",
    "time guided", "time nominal",
)  # fmt: skip


def main(settings: Settings) -> None:
    prepare_jax()
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    for size in settings.sizes:
        for row in rows(settings, size):
            print("| " + " | ".join(row) + " |", flush=True)
    print(
        f"\n{settings.cases} cases of changed requirements; the first row of each size takes 100 steps and evaluates the "
        f"field at each, the others have {settings.steps} steps of guidance. deviation, error: RMS distance per object, "
        "in z, to the nominal sample of 100 steps. nominal, default: nominal samples that meet the default requirements. "
        "times: over those of the first row, median of the rounds."
    )


def rows(settings: Settings, size: int) -> list[list[str]]:
    """The table's rows of one size."""
    from deggflow import EveryStep, Extrapolated
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.condition import padded_size, to_arrays
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.requirements import tabletop_guidance
    from deggflow.tasks.tabletop.verdict import judge

    field, guidance = load_field(), tabletop_guidance()
    conditions = random_conditions(size, settings.cases, "changed", settings.seed)
    default = [replace(c, requirements={}, balance=None, given=None) for c in conditions]
    noise = initial_noise(settings.seed, np.arange(settings.cases), 0)
    arrays = to_arrays(conditions, padded_size(size))
    ways: dict[int, dict[str, Any]] = {101: {"drift": EveryStep()}}
    for count in settings.evaluations:
        drift = Extrapolated(count, settings.order, settings.power)
        ways[count] = {"drift": drift, "steps": settings.steps}
    generators = {
        (count, guided): TabletopGenerator(field, guidance if guided else None, **way)
        for count, way in ways.items()
        for guided in (True, False)
    }
    batches = {
        name: generator.batch(noise, conditions) for name, generator in generators.items()
    }  # compiles, too
    taken: dict[tuple[int, bool], list[float]] = {name: [] for name in generators}
    for _ in range(settings.rounds):
        for name, generator in generators.items():
            start = time.perf_counter()
            generator.draw(noise[:, : arrays.mask.shape[1]], arrays)
            taken[name].append(time.perf_counter() - start)
    reference = batches[101, False].z

    def distance(z: Any) -> float:
        difference = (z - reference)[:, :size]
        return float(np.sqrt(np.mean(np.sum(difference**2, axis=-1))))

    def ratio(name: tuple[int, bool]) -> float:
        return float(np.median(np.divide(taken[name], taken[101, name[1]])))

    table = []
    for count in ways:
        guided, nominal = batches[count, True], batches[count, False]
        satisfied = sum(verdict.satisfied for verdict in judge(conditions, guided.poses))
        natural = sum(verdict.satisfied for verdict in judge(default, nominal.poses))
        hold = sum(each is not None and each.hypotheses_hold for each in guided.records)
        table.append(
            [
                str(size), str(count), f"{satisfied} of {settings.cases}", str(hold), f"{distance(guided.z):.3f}",
                str(natural), f"{distance(nominal.z):.3f}", f"{ratio((count, True)):.2f}",
                f"{ratio((count, False)):.2f}",
            ]
        )  # fmt: skip
    return table


if __name__ == "__main__":
    main(tyro.cli(Settings))
