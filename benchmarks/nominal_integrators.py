"""How few evaluations of the tabletop's field give nominal scenes as natural as 100 Euler steps do, by integrator.

Usage: python benchmarks/nominal_integrators.py [--sizes 4 5 6 7 8 10 12] [--cases 10000] [--evaluations 16] [--all]
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tyro

from deggflow.app.session import prepare_jax


@dataclass(frozen=True)
class Settings:
    """What is compared."""

    sizes: tuple[int, ...] = (4, 5, 6, 7, 8, 10, 12)  # objects of a scene
    cases: int = 10_000
    evaluations: int = 16  # of the field, in a generation
    all: bool = False  # every candidate, not only the tabletop's default
    seed: int = 1


def main(settings: Settings) -> None:
    prepare_jax()
    head = ("N", "integrator", "natural", "difference", "only many", "only few", "error")
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for size in settings.sizes:
        for row in rows(settings, size):
            print("| " + " | ".join(row) + " |", flush=True)
    print(
        f"\n{settings.cases} cases, seed {settings.seed}. natural: nominal scenes that meet the default requirements, with "
        "95% Wilson intervals; difference: to 100 Euler steps from the same z(0), in percentage points, with a 95% interval; "
        "only many, only few: natural with 100 steps or with few evaluations alone; error: RMS distance per object, in z, to "
        "the sample of 100 steps."
    )


def candidates(settings: Settings) -> dict[str, Any]:
    from deggflow import Extrapolated, ExtrapolatedEndpoint, Midpoint

    count = settings.evaluations
    if not settings.all:
        return {f"endpoint, order 3, power 2.5, {count}": ExtrapolatedEndpoint(count)}
    return {
        f"{name}, power {power}, {count}": make(power)
        for power in (1.0, 1.5, 2.0, 2.5, 3.0)
        for name, make in {
            "midpoint": lambda power: Midpoint(count // 2 * 2, power),
            "field, order 2": lambda power: Extrapolated(count, 2, power),
            "field, order 3": lambda power: Extrapolated(count, 3, power),
            "endpoint, order 2": lambda power: ExtrapolatedEndpoint(count, 2, power),
            "endpoint, order 3": lambda power: ExtrapolatedEndpoint(count, 3, power),
        }.items()
    }


def rows(settings: Settings, size: int) -> list[list[str]]:
    """The table's rows of one size."""
    from deggflow import EveryStep
    from deggflow.statistics import Rate
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.verdict import judge

    field = load_field()
    conditions = random_conditions(size, settings.cases, "changed", settings.seed)
    default = [replace(c, requirements={}, balance=None, given=None) for c in conditions]
    noise = initial_noise(settings.seed, np.arange(settings.cases), 0)

    def drawn(drift: Any, steps: int) -> tuple[Any, Any]:
        made = TabletopGenerator(field, steps=steps, drift=drift).batch(noise, default)
        natural = np.array([verdict.satisfied for verdict in judge(default, made.poses)])
        return made.z[:, :size], natural

    reference, natural = drawn(EveryStep(), 100)
    table = [
        [
            str(size),
            "100 Euler steps",
            str(Rate(int(natural.sum()), settings.cases)),
            "",
            "",
            "",
            "0",
        ]
    ]
    for name, drift in candidates(settings).items():
        z, few = drawn(drift, settings.evaluations)  # the path between macro points is not needed
        lost, won = int(np.sum(natural & ~few)), int(np.sum(~natural & few))
        error = np.sqrt(np.mean(np.sum((z - reference) ** 2, axis=-1)))
        table.append(
            [
                str(size), name, str(Rate(int(few.sum()), settings.cases)), paired(lost, won, settings.cases),
                str(lost), str(won), f"{error:.3f}",
            ]
        )  # fmt: skip
    return table


def paired(lost: int, won: int, cases: int) -> str:
    """Difference of two proportions of the same cases, in percentage points, with its 95% interval."""
    difference = (won - lost) / cases
    width = 1.96 * np.sqrt((won + lost) / cases - difference**2) / np.sqrt(cases)
    return f"{100 * difference:+.2f} [{100 * (difference - width):+.2f}, {100 * (difference + width):+.2f}]"


if __name__ == "__main__":
    main(tyro.cli(Settings))
