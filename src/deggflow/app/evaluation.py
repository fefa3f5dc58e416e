"""Tables of `deggflow tabletop evaluate`."""

import json
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

from rich.table import Table

from deggflow.flow import Field
from deggflow.tasks.tabletop.evaluate import (
    ALLOCATIONS,
    Comparison,
    Evaluation,
    Failure,
    compare,
    evaluate,
)

from .runs import run_jobs
from .session import NOT_SATISFIED, SATISFIED, output


def run_evaluation(
    field: Field, settings: dict[str, Any], out: Path | None, failures: Path | None
) -> int:
    """Nominal beside guided for each size and family; exit code 3 if a case was never satisfied."""
    grid = list(product(settings["requirements"], settings["sizes"]))
    cases, seed, max_draws = settings["cases"], settings["seed"], settings["max_draws"]

    def job(family: str, size: int) -> Callable[[], Evaluation]:
        def run() -> Evaluation:
            refused: list[Failure] = []
            row = evaluate(field, size, family, cases, seed, max_draws, on_failure=refused.append)
            if failures is not None:
                with failures.open("a") as lines:
                    lines.writelines(json.dumps(each.to_json()) + "\n" for each in refused)
            return row

        return run

    rows = run_jobs([job(*point) for point in grid], Evaluation, settings, out)
    table = Table(
        title=f"Tabletop: success, {cases} cases a row, seed {seed}, 95% Wilson intervals",
        title_justify="left",
    )
    for heading in (
        "N",
        "requirements",
        "nominal default",
        "nominal changed",
        "guided, first draw",
        f"guided, <= {max_draws} draws",
        "most draws",
        "refuted",
    ):
        table.add_column(heading, no_wrap=True)
    for row in rows:
        rates = [row.nominal_default, row.nominal_changed, row.first_draw, row.satisfied]
        table.add_row(
            str(row.size),
            row.requirements,
            *(str(row.rate(count)) for count in rates),
            str(row.most_draws),
            str(row.refuted),
        )
    output().print(table)
    output().print(
        "nominal default: the nominal scene under the default requirements; nominal changed: the same scene under the changed ones; "
        "guided: from the same z(0); refuted: claims of success that the Shapely oracle found false."
    )
    output().print(_on_the_way(rows))
    output().print(
        "conditions held: rows feasible and V below its limit at every accepted point of the first draw; contradicted: "
        "these, and yet refused by the verdict; evaluations: of the guided field (100 steps and the end: 101)."
    )
    complete = all(row.satisfied == row.cases and not row.refuted for row in rows)
    return SATISFIED if complete else NOT_SATISFIED


def _on_the_way(rows: list[Evaluation]) -> Table:
    table = Table(title="On the way of the first draws", title_justify="left")
    for heading in (
        "N",
        "requirements",
        "conditions held",
        "contradicted",
        "with a forced step",
        "evaluations: median, 99%, most",
    ):
        table.add_column(heading, no_wrap=True)
    for row in rows:
        table.add_row(
            str(row.size),
            row.requirements,
            str(row.rate(row.held)),
            str(row.contradicted),
            str(row.forced),
            ", ".join(f"{number:.0f}" for number in row.evaluations),
        )
    return table


def run_comparison(field: Field, settings: dict[str, Any], out: Path | None) -> int:
    """The three allocations, re-anchored and not, on first draws."""
    grid = list(product(settings["requirements"], settings["sizes"], ALLOCATIONS, (False, True)))
    cases, seed = settings["cases"], settings["seed"]

    def job(family: str, size: int, allocation: str, anew: bool) -> Callable[[], Comparison]:
        return lambda: compare(
            field, size, family, cases, seed, allocation=allocation, reanchored=anew
        )

    rows = run_jobs([job(*point) for point in grid], Comparison, settings, out)
    table = Table(
        title=f"Tabletop: first draws, {cases} cases a row, seed {seed}, 95% Wilson intervals",
        title_justify="left",
    )
    for heading in (
        "N",
        "requirements",
        "allocation",
        "re-anchored",
        "guided, first draw",
        "deviation",
    ):
        table.add_column(heading, no_wrap=True)
    for (family, *_), row in zip(grid, rows, strict=True):
        table.add_row(
            str(row.size),
            family,
            row.allocation,
            "yes" if row.reanchored else "no",
            str(row.rate()),
            f"{row.deviation:.3f}",
        )
    output().print(table)
    output().print(
        "Same cases and z(0) in every row of a size. deviation: RMS distance to the nominal sample, in z, per object."
    )
    return SATISFIED
