"""The fleet's plans beside prioritised planning and a joint projection, with the same field, conditions and z(0).

Usage: python benchmarks/fleet_baselines.py [--sizes 3 6 9] [--maps empty conveyor highways drop_region dense] [--cases 4]

With `--together 512`: many plans of ours at once beside prioritised planning, which plans one team after the other.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from deggflow.app.session import prepare_jax

# Solved of trials, as others' own code was measured elsewhere, with a mixture of Gaussians as the denoiser and each
# method's own check of collisions at waypoints; seconds of CPU a plan.
ELSEWHERE = (
    ("empty", 6, "MMD's code, prioritised", "2/2", "9 to 29 s"),
    ("conveyor", 6, "MMD's code, prioritised", "0/5", "9 to 29 s"),
    ("highways", 6, "MMD's code, prioritised", "1/1", "9 to 29 s"),
    ("drop_region", 6, "MMD's code, prioritised", "1/1", "9 to 29 s"),
    ("dense", 6, "MRMP's code, projection by IPOPT", "1/1", "20 s"),
    ("dense", 9, "MRMP's code, projection by IPOPT", "0/1", "42 s"),
    ("dense", 15, "MRMP's code, projection by IPOPT", "0/1", "45 s"),
)


@dataclass(frozen=True)
class Settings:
    """What is compared."""

    sizes: tuple[int, ...] = (3, 6, 9)
    maps: tuple[str, ...] = ("empty", "conveyor", "highways", "drop_region", "dense")
    cases: int = (
        4  # of each map and size; MMD's own starts and goals where a map has them, else random ones
    )
    samples: int = 8  # paths that a robot draws at once in prioritised planning
    together: int = 0  # if positive: so many plans of ours at once, for the largest of `sizes`, and nothing else
    rounds: int = 3  # of these; the median counts
    seed: int = 1
    weights: Path | None = None


Way = Callable[[Any, np.ndarray, int], np.ndarray]
"""(condition, z(0), number of the case) -> paths."""


def ways(settings: Settings) -> dict[str, Way]:
    from deggflow.tasks.fleet.field import load_field
    from deggflow.tasks.fleet.generator import FleetGenerator
    from deggflow.tasks.fleet.options import FleetFieldOptions
    from deggflow.tasks.fleet.prioritised import denoiser, prioritised
    from deggflow.tasks.fleet.projected import Projection

    field, options = load_field(settings.weights), FleetFieldOptions()
    ours, nominal = FleetGenerator(field, options), FleetGenerator(field, options, guided=False)
    program, project = denoiser(field), Projection()

    def drawn(condition: Any, noise: np.ndarray, number: int) -> np.ndarray:
        return ours.plans([condition], seed=settings.seed, first=number)[0].paths

    def redrawn(condition: Any, noise: np.ndarray, number: int) -> np.ndarray:
        return ours.plans([condition], seed=settings.seed, first=number, max_draws=16)[0].paths

    def plain(condition: Any, noise: np.ndarray, number: int) -> np.ndarray:
        return nominal.batch(noise[None, :1], [condition]).paths[0]

    def one_by_one(condition: Any, noise: np.ndarray, number: int) -> np.ndarray:
        own = noise.swapaxes(0, 1)[: len(condition.robots)]
        return prioritised(program, condition, own).paths

    def projected(condition: Any, noise: np.ndarray, number: int) -> np.ndarray:
        return project(plain(condition, noise, number), condition).paths

    return {
        "nominal": plain,
        "ours, first draw": drawn,
        "ours, <= 16 draws": redrawn,
        "prioritised, as MMD": one_by_one,
        "joint projection, as MRMP": projected,
    }


def problems(settings: Settings, name: str, size: int, count: int) -> tuple[list[Any], np.ndarray]:
    """Conditions, with MMD's own starts and goals where a map has them, and z(0) of several paths of each robot."""
    from deggflow.tasks.fleet.condition import padding
    from deggflow.tasks.fleet.drawn import random_conditions
    from deggflow.tasks.fleet.generator import initial_noise
    from deggflow.tasks.fleet.schemes import OWN

    scheme: Any = "own" if name in OWN else "random"
    conditions = random_conditions(size, count, name, scheme, settings.seed)  # type: ignore[arg-type]
    agents = padding(conditions).agents
    return conditions, initial_noise(settings.seed, np.arange(count), 0, agents, settings.samples)


def rows(settings: Settings, name: str, size: int, compared: dict[str, Way]) -> list[Sequence[str]]:
    from deggflow.tasks.fleet.verdict import judge

    conditions, noise = problems(settings, name, size, settings.cases)
    seconds: dict[str, list[float]] = {way: [] for way in compared}
    paths: dict[str, list[np.ndarray]] = {way: [] for way in compared}
    for number, condition in enumerate(conditions):
        for way, make in compared.items():
            if number == 0:
                make(condition, noise[number], number)  # compiles
            start = time.process_time()
            paths[way].append(make(condition, noise[number], number))
            seconds[way].append(time.process_time() - start)
    out = []
    for way in compared:
        solved = sum(verdict.satisfied for verdict in judge(conditions, paths[way]))
        off = [
            np.sqrt(np.mean(np.sum((a - b) ** 2, axis=-1)))
            for a, b in zip(paths[way], paths["nominal"], strict=True)
        ]
        cpu = np.median(seconds[way])
        times = f"{cpu / np.median(seconds['ours, first draw']):.2g}"
        out.append(
            (
                name, str(size), way, f"{solved}/{settings.cases}", f"{np.median(off):.3f}",
                f"{1e3 * cpu:.0f} ms", times,
            )
        )  # fmt: skip
    return out


def many_at_once(settings: Settings) -> None:
    """Wall time a plan, and a valid one: all plans' time over the number of those that the exact verdict accepts.

    Ours are made in one batch, prioritised planning plans team by team on the device or a CPU, whichever is faster.
    """
    import jax

    from deggflow.tasks.fleet.field import load_field
    from deggflow.tasks.fleet.generator import FleetGenerator
    from deggflow.tasks.fleet.options import FleetFieldOptions
    from deggflow.tasks.fleet.prioritised import denoiser
    from deggflow.tasks.fleet.verdict import judge

    field, size = load_field(settings.weights), max(settings.sizes)
    ours, program = FleetGenerator(field, FleetFieldOptions()), denoiser(field)
    print(
        f"JAX on {jax.devices()[0].device_kind}; {size} robots, seed {settings.seed}, wall time\n"
    )
    rest = ("a plan", "times ours", "a valid plan", "times ours")
    _print_row(("map", "ours", "a plan", "prioritised", *rest))
    _print_row(["---"] * 8)
    for name in settings.maps:
        conditions, noise = problems(settings, name, size, settings.together)
        batch = partial(ours.plans, conditions, seed=settings.seed)
        held = sum(plan.certificate.satisfied for plan in batch())  # compiles
        each = np.median([_seconds(batch) for _ in range(settings.rounds)]) / len(conditions)
        some = conditions[: settings.cases]
        platform, seconds, paths = team_by_team(program, some, noise)
        solved = sum(verdict.satisfied for verdict in judge(some, paths))
        valid, more = sum(seconds) / max(solved, 1), "" if solved else "over "
        times = valid / (each * len(conditions) / held)
        median = np.median(seconds)
        _print_row(
            (
                name, f"{held}/{len(conditions)}", f"{1e3 * each:.2f} ms", f"{solved}/{len(some)}",
                f"{1e3 * median:.0f} ms ({platform})", f"{median / each:.0f}",
                f"{more}{1e3 * valid:.0f} ms", f"{more}{times:.0f}",
            )
        )  # fmt: skip
    print(
        "\na plan: of ours, wall time of the batch over its size, median of rounds; of prioritised planning, the median. a valid "
        "plan: the time of all plans over the number that the exact verdict accepts."
    )


def team_by_team(
    program: Any, conditions: Sequence[Any], noise: np.ndarray
) -> tuple[str, list[float], list[np.ndarray]]:
    """Prioritised planning on the faster of JAX's device and a CPU: which that is, seconds and paths of each condition."""
    import jax

    from deggflow.tasks.fleet.prioritised import prioritised

    results = {}
    for device in {each.platform: each for each in (*jax.devices(), *jax.devices("cpu"))}.values():
        with jax.default_device(device):
            calls = [
                partial(
                    prioritised, program, condition, own.swapaxes(0, 1)[: len(condition.robots)]
                )
                for condition, own in zip(conditions, noise[: len(conditions)], strict=True)
            ]
            paths = [call().paths for call in calls]  # compiles
            results[device.platform] = [_seconds(call) for call in calls], paths
    best = min(results, key=lambda platform: float(np.median(results[platform][0])))
    return best, *results[best]


def _print_row(cells: Sequence[str]) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def _seconds(call: Callable[[], object]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def one_at_a_time(settings: Settings) -> None:
    """CPU time a plan of every way, and what it solves."""
    compared = ways(settings)
    head = ("map", "N", "way", "solved", "RMS from nominal", "CPU a plan, median", "times ours")
    _print_row(head)
    _print_row(["---"] * len(head))
    for name in settings.maps:
        for size in settings.sizes:
            for row in rows(settings, name, size, compared):
                _print_row(row)
    for name, size, way, solved, cpu in ELSEWHERE:
        _print_row((name, str(size), way, f"{solved}, elsewhere", "-", cpu, "-"))
    print(
        f"\nsolved: by the exact verdict at all times, speed limit included; batch 1, {settings.cases} cases a row, seed "
        f"{settings.seed}; every way from the same z(0), prioritised with {settings.samples} paths a draw. Rows marked "
        "elsewhere: the authors' own code, a few trials, their own checks at waypoints, no speed limit (yoraish/mmd; "
        "RAISELab-atUVA/Diffusion-MRMP)."
    )


def main(settings: Settings) -> None:
    prepare_jax()
    (many_at_once if settings.together else one_at_a_time)(settings)


if __name__ == "__main__":
    main(tyro.cli(Settings))
