"""`deggflow tabletop baselines`: every guidance method, swept over its own hyperparameters."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deggflow.jsonl import InputError
from deggflow.shards import parse_shard
from deggflow.task import check_range
from deggflow.task.options import MAX_COUNT, MAX_SEED

from .engine import LOCAL, AnyEngine
from .session import SATISFIED, prepare_jax

if TYPE_CHECKING:
    from deggflow.tasks.tabletop.baselines import Method
    from deggflow.tasks.tabletop.frontier import Point


def baselines(
    cases: int = 128,
    sizes: tuple[int, ...] = (8,),
    methods: tuple[str, ...] = (),
    seed: int = 1001,
    chosen: bool = False,
    out: Path | None = None,
    engine: AnyEngine = LOCAL,
    shard: str | None = None,
) -> int:
    """Compare guidance methods: success, deviation and time of each, for every setting of its hyperparameters.

    All methods run on the same field, from the same z(0), under the same requirements. Only rejection sampling
    draws more than once. A star marks the best setting of each method: most successes, then least W2.

    Args:
        cases: Random cases of each size.
        sizes: Numbers of objects.
        methods: Names of the methods to compare (default: all).
        seed: Seed of cases and of z(0). The settings in the published tables were tuned with the default seed, at N = 8 and 12.
        chosen: Run only the settings in the published tables, not the whole grid.
        out: JSON Lines file that receives the rows; rerun the command to resume.
        engine: Which processes measure. With ray, times depend on what else a worker's machine does.
        shard: k/n: measure only shard number k of n of the rows. With the merged file as --out, the command without --shard prints the table.
    """
    part = parse_shard(shard, out)
    from deggflow.tasks.tabletop.library import MAX_OBJECTS

    check_range("cases", cases, 1, MAX_COUNT)
    check_range("seed", seed, 0, MAX_SEED)
    for size in sizes:
        check_range("sizes", size, 1, MAX_OBJECTS)
    compared_methods = _methods(methods)
    prepare_jax()
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.frontier import Point, jobs

    from .runs import provenance, run_jobs

    grid = [
        (size, method, hyperparameters)
        for size in sizes
        for method in compared_methods
        for hyperparameters in ((method.chosen(size),) if chosen else method.grid)
    ]
    settings = {
        "command": "tabletop baselines",
        "cases": cases,
        "seed": seed,
        "rows": [
            [size, method.name, dict(hyperparameters)] for size, method, hyperparameters in grid
        ],
    }
    rows: Sequence[Callable[[], Point]] = jobs(load_field(), grid, cases, seed)
    if engine.ray:
        from deggflow.tasks.tabletop.model import TabletopModel

        from .cluster import Cluster, Work, measure_method, rows_by

        work = Work("tabletop", (cases, seed), provenance(TabletopModel(), None))
        calls = [(work, size, method.name, dict(setting)) for size, method, setting in grid]
        cluster = Cluster(engine.address, engine.cpus)
        rows = rows_by(cluster, measure_method, calls, Point, part)
    points = run_jobs(rows, Point, settings, out, part)
    if part is None:
        _show(points, cases, seed)
    return SATISFIED


def _methods(names: tuple[str, ...]) -> "list[Method]":
    """The methods of these names, in their usual order; all if there are no names."""
    from deggflow.tasks.tabletop.baselines import METHODS

    known = [method.name for method in METHODS]
    for name in names:
        if name not in known:
            raise InputError(
                f"--methods: there is no method {name!r}; known are {', '.join(map(repr, known))}"
            )
    return [method for method in METHODS if not names or method.name in names]


def _show(points: "list[Point]", cases: int, seed: int) -> None:
    from deggflow.task import Table
    from deggflow.tasks.tabletop.frontier import best, in_words

    from .tables import show

    groups: dict[tuple[int, str], list[Point]] = {}
    for point in points:
        groups.setdefault((point.size, point.method), []).append(point)
    stars = [best(group) for group in groups.values()]
    rows = [
        (
            point.size,
            point.method,
            in_words(point.hyperparameters) + " *" * any(point is star for star in stars),
            point.rate(),
            f"{1000 * point.worst:.1f} mm",
            point.diverged,
            "" if point.transport is None else f"{point.transport:.3f}",
            f"{1000 * point.seconds:.1f} ms",
            f"{point.draws:.2f}",
        )
        for point in points
    ]
    headings = ("N", "method", "setting", "success", "worst", "diverged", "W2", "time", "draws")
    title = f"Tabletop: guidance methods, {cases} cases a row, seed {seed}, 95% Wilson intervals"
    note = (
        "worst: greatest violation of a margin; W2: Wasserstein distance to the nominal samples, in z, per object, by optimal "
        "assignment of all cases; time: per scene in batches, compiled; *: the best setting of a method, with the most successes, "
        "then the least W2."
    )
    show(Table(title, headings, rows, note))
