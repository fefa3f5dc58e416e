"""How many steps guidance takes after a prediction: what comes out, and how often guidance is evaluated.

Usage: python benchmarks/guidance_steps.py [--steps 100 50 25] [--sizes 8 12] [--cases 10000]
"""

from dataclasses import dataclass

import numpy as np
import tyro

from deggflow.app.session import prepare_jax


@dataclass(frozen=True)
class Settings:
    """What is compared."""

    steps: tuple[int, ...] = (100, 50, 25)
    sizes: tuple[int, ...] = (8, 12)
    cases: int = 10_000  # of changed requirements
    seed: int = 1


HEAD = (
    "N",
    "steps",
    "satisfied, first draw",
    "with forced steps",
    "deviation",
    "evaluations, mean",
)


def main(settings: Settings) -> None:
    prepare_jax()
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}")
    for size in settings.sizes:
        for row in scenes(settings, size):
            print(f"| {' | '.join(row)} |", flush=True)
    print(
        f"\n{settings.cases} cases of changed requirements, seed {settings.seed}; deviation: RMS distance per object, in z, to "
        "the nominal scene, which all rows share; evaluations: of the guidance, one for each step, refused ones too, and one "
        "at the end"
    )


def scenes(settings: Settings, size: int) -> list[tuple[str, ...]]:
    """The table's rows of one size."""
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.requirements import tabletop_guidance
    from deggflow.tasks.tabletop.verdict import judge

    field, rows = load_field(), []
    conditions = random_conditions(size, settings.cases, "changed", settings.seed)
    noise = initial_noise(settings.seed, np.arange(settings.cases), 0)
    nominal = TabletopGenerator(field).batch(noise, conditions).z[:, :size]
    for steps in settings.steps:
        generator = TabletopGenerator(field, tabletop_guidance(), steps=steps)
        made = generator.batch(noise, conditions)
        records = [record for record in made.records if record is not None]
        evaluations = np.mean([1 + record.steps + record.refused_steps for record in records])
        deviation = np.sqrt(np.mean(np.sum((made.z[:, :size] - nominal) ** 2, axis=-1)))
        satisfied = sum(verdict.satisfied for verdict in judge(conditions, made.poses))
        forced = sum(record.forced_steps > 0 for record in records)
        rows.append(
            (
                str(size), str(steps), f"{satisfied:,} of {settings.cases:,}", str(forced), f"{deviation:.4f}",
                f"{evaluations:.1f}",
            )
        )  # fmt: skip
    return rows


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
