"""Time of guided over nominal generation of tabletop scenes: same field, z(0), grid and batch, run in turn.

Usage: python benchmarks/guided_over_nominal.py [--size 8] [--batch 500] [--rounds 7]
"""

import time
from dataclasses import dataclass

import numpy as np
import tyro

from deggflow.app.session import prepare_jax

GUARDED, FIXED = "pooled, re-anchored (default)", "the same, fixed steps"


@dataclass(frozen=True)
class Settings:
    """What is timed."""

    size: int = 8
    batch: int = 500
    rounds: int = 7
    seed: int = 0


def main(settings: Settings) -> None:
    prepare_jax()
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.requirements import LOCAL, OWN, tabletop_guidance

    field = load_field()
    ways = {
        "nominal": TabletopGenerator(field),
        GUARDED: TabletopGenerator(field, tabletop_guidance()),
        FIXED: TabletopGenerator(field, tabletop_guidance(), guard=None),
        "own (paper)": TabletopGenerator(field, tabletop_guidance(OWN, reanchored=False)),
        "local, re-anchored": TabletopGenerator(field, tabletop_guidance(LOCAL)),
    }
    conditions = random_conditions(settings.size, settings.batch, "changed", settings.seed)
    noise = initial_noise(settings.seed, np.arange(settings.batch), 0)
    for way in ways.values():
        way.batch(noise, conditions)  # compiles
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(settings.rounds):
        for name, way in ways.items():
            start = time.perf_counter()
            way.batch(noise, conditions)
            seconds[name].append(time.perf_counter() - start)
    print(
        f"batch of {settings.batch}, N = {settings.size}, 100 Euler steps, {settings.rounds} rounds"
    )
    print(f"{'':32}{'median s':>10}{'ratio to nominal: median (min, max) over rounds':>50}")
    for name, times in seconds.items():
        ratio = np.divide(times, seconds["nominal"])
        spread = f"{np.median(ratio):.2f} ({ratio.min():.2f}, {ratio.max():.2f})"
        print(f"{name:32}{np.median(times):>10.2f}{spread:>50}")
    dear = np.divide(seconds[GUARDED], seconds[FIXED])
    records = ways[GUARDED].batch(noise, conditions).records
    taken = np.array([made.steps + made.refused + 1 for made in records if made is not None])
    median, late, most = np.quantile(taken, [0.5, 0.99, 1.0])
    print(
        f"guarded over fixed steps: {np.median(dear):.2f} ({dear.min():.2f}, {dear.max():.2f}); evaluations of the guided "
        f"field per scene, 101 with fixed steps: median {median:.0f}, 99% {late:.0f}, most {most:.0f}"
    )


if __name__ == "__main__":
    main(tyro.cli(Settings))
