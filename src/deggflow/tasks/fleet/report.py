"""What `deggflow fleet evaluate` measures and prints: success by map, scheme and number of robots."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from deggflow.flow import Field
from deggflow.statistics import SuccessRow
from deggflow.task import AbstractEvaluation, Table

from .drawn import random_conditions
from .generator import FleetGenerator
from .options import FleetEvaluate
from .oracle import refutes
from .plan import Plan
from .schemes import OWN


@dataclass(frozen=True)
class FleetEvaluation(SuccessRow):
    """One map, scheme and size; margins in map units. With MMD's own scheme all cases are alike but for z(0).

    Attributes:
        map: Name of the map.
        scheme: Of starts and goals.
        forced: First draws with a step that had to be taken above its limit.
        milliseconds: A plan at its first draw, in a batch of all cases, programs compiled.
        missed: Of first draws that fail, how often each requirement has the least margin.
        failure: Reason of the first plan that fails within the limit of draws, or at its first draw; None if none does.
    """

    map: str
    scheme: str
    forced: int
    milliseconds: float
    missed: dict[str, int]
    failure: str | None

    def to_json(self) -> dict[str, Any]:
        """The fields by name, as a file holds them: what the row is of comes first."""
        return {"map": self.map, "scheme": self.scheme, **super().to_json()}


def evaluate(
    field: Field, options: FleetEvaluate, name: Any, scheme: Any, size: int
) -> FleetEvaluation:
    """Nominal and guided plans of one map, scheme and size; every claim is checked by the oracle."""
    conditions = random_conditions(size, options.cases, name, scheme, options.seed)
    nominal = FleetGenerator(field, options, guided=False).plans(conditions, seed=options.seed)
    guided = FleetGenerator(field, options)
    guided.plans(conditions, seed=options.seed)  # compiles
    begin = time.perf_counter()
    first = guided.plans(conditions, seed=options.seed)
    seconds = time.perf_counter() - begin
    plans = guided.plans(conditions, seed=options.seed, max_draws=options.max_draws)
    claims = [plan for plan in plans if _satisfied(plan)]
    failed = [plan for plan in first if not _satisfied(plan)]
    margins = [plan.certificate.min_margin for plan in claims]
    worst = next((plan for plan in plans if not _satisfied(plan)), failed[0] if failed else None)
    forced = [g.forced_steps for plan in first if (g := plan.certificate.generation) is not None]
    return FleetEvaluation(
        size,
        options.cases,
        map=name,
        scheme=scheme,
        nominal=sum(map(_satisfied, nominal)),
        first_draw=options.cases - len(failed),
        satisfied=len(claims),
        most_draws=max(plan.certificate.draws for plan in plans),
        least_margin=min(margins, default=None),
        refuted=sum(refutes(plan.condition, plan.paths) for plan in claims),
        forced=int(np.count_nonzero(forced)),
        milliseconds=1e3 * seconds / options.cases,
        missed=dict(Counter(plan.verdict().worst.kind for plan in failed)),
        failure=None if worst is None else worst.certificate.reason,
    )


def _satisfied(plan: Plan) -> bool:
    return plan.certificate.satisfied


class SuccessEvaluation(AbstractEvaluation[FleetEvaluation]):
    """Nominal and guided plans for each map, scheme and size."""

    row = FleetEvaluation

    def __init__(self, field: Field, options: FleetEvaluate, weights: str | None) -> None:
        """Args: as for `AbstractTask.evaluation`."""
        self.field, self.options = field, options
        self.settings = {
            **options.settings("fleet", weights),
            "candidates": options.candidates,
            "cases": options.cases,
            "sizes": list(options.sizes),
            "maps": list(options.maps),
            "schemes": list(options.schemes),
        }
        cells = product(options.maps, options.schemes, options.sizes)
        self.jobs = [self._job(*cell) for cell in cells if cell[1] == "random" or cell[0] in OWN]

    def _job(self, name: str, scheme: str, size: int) -> Callable[[], FleetEvaluation]:
        return lambda: evaluate(self.field, self.options, name, scheme, size)

    def tables(self, rows: Sequence[FleetEvaluation]) -> list[Table | str]:
        """A table of success, and one of failures if there are any."""
        options = self.options
        success = Table(
            f"Fleet: success, {options.cases} cases per row, seed {options.seed}, 95% Wilson intervals",
            (
                "map", "starts", "N", "nominal", "first draw", f"<= {options.max_draws} draws",
                "most draws", "least margin", "refuted", "forced", "ms a plan",
            ),
            [
                (
                    row.map, row.scheme, row.size, row.rate(row.nominal), row.rate(row.first_draw),
                    row.rate(row.satisfied), row.most_draws,
                    row.margin_text,
                    row.refuted, row.forced, f"{row.milliseconds:.1f}",
                )
                for row in rows
            ],
            "nominal: from the first z(0); least margin: of claims of success, in map units; refuted: claims that Shapely or a "
            "check at many moments finds false; forced: first draws with a step above its limit; ms a plan: a first draw in a "
            "batch of all cases, verdict and certificate included, without compilation.",
        )  # fmt: skip
        failed = [row for row in rows if row.failure is not None]
        if not failed:
            return [success]
        return [success, _failures(failed)]

    def complete(self, rows: Sequence[FleetEvaluation]) -> bool:
        """Whether every case was satisfied, and no claim of it refuted."""
        return all(row.complete for row in rows)


def _failures(rows: Sequence[FleetEvaluation]) -> Table:
    instances = [f"{row.map}, {row.scheme}, N = {row.size}: {row.failure}" for row in rows]
    return Table(
        "Fleet: what failed",
        ("map", "starts", "N", "missed at the first draw"),
        [
            (
                row.map, row.scheme, row.size,
                ", ".join(f"{kind} {count}" for kind, count in sorted(row.missed.items())),
            )
            for row in rows
        ],
        "missed: the requirement with the least margin, of first draws that fail. One of each:\n"
        + "\n".join(instances),
    )  # fmt: skip
