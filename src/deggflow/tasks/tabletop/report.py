"""What `deggflow tabletop evaluate` measures and prints."""

import json
from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product
from typing import Any, TypeVar

from deggflow.flow import Field
from deggflow.statistics import Row
from deggflow.task import AbstractEvaluation, Table

from .evaluate import ALLOCATIONS, Comparison, Evaluation, Failure, compare, evaluate
from .generator import few_evaluations
from .options import TabletopEvaluate

R = TypeVar("R", bound=Row)


class _EvaluationOfSizes(AbstractEvaluation[R]):
    """What is measured for each family and size, and for all else that rows differ in.

    Attributes:
        variants: Values of all else.
        points: Family, size and variant of each row.
    """

    variants: Sequence[Collection[Any]] = ()

    def __init__(
        self, field: Field, options: TabletopEvaluate, settings: Mapping[str, Any]
    ) -> None:
        """Args: as of `evaluation_of`."""
        self.field, self.options, self.settings = field, options, settings
        self.points = list(product(options.requirements, options.sizes, *self.variants))
        self.jobs = [self._job(*point) for point in self.points]

    @abstractmethod
    def _job(self, family: str, size: int, *variant: Any) -> Callable[[], R]:
        """Measures one row."""


class SuccessEvaluation(_EvaluationOfSizes[Evaluation]):
    """Nominal and guided scenes for each size and family."""

    row = Evaluation

    def _job(self, family: str, size: int, *variant: Any) -> Callable[[], Evaluation]:
        options = self.options

        def run() -> Evaluation:
            refused: list[Failure] = []
            row = evaluate(
                self.field, size, family, options.cases, options.seed, options.max_draws,
                drift=few_evaluations(options), on_failure=refused.append,
            )  # fmt: skip
            if options.failures is not None:
                with options.failures.open("a") as lines:
                    lines.writelines(json.dumps(each.to_json()) + "\n" for each in refused)
            return row

        return run

    def tables(self, rows: Sequence[Evaluation]) -> list[Table]:
        """Success, and statistics of the first draws' generation."""
        return [self._success(rows), self._first_draws(rows)]

    def _success(self, rows: Sequence[Evaluation]) -> Table:
        options = self.options
        return Table(
            f"Tabletop: success, {options.cases} cases per row, seed {options.seed}, 95% Wilson intervals",
            (
                "N", "requirements", "nominal default", "nominal changed", "guided, first draw",
                f"guided, <= {options.max_draws} draws", "most draws", "refuted",
            ),
            [
                (
                    row.size,
                    row.requirements,
                    *map(
                        row.rate,
                        (row.nominal_default, row.nominal_changed, row.first_draw, row.satisfied),
                    ),
                    row.most_draws,
                    row.refuted,
                )
                for row in rows
            ],
            "nominal default: the nominal scene under the default requirements; nominal changed: the same scene under the changed ones; "
            "guided: from the same z(0); refuted: claims of success that the Shapely oracle found false.",
        )  # fmt: skip

    def _first_draws(self, rows: Sequence[Evaluation]) -> Table:
        return Table(
            "Tabletop: generation of the first draws",
            (
                "N", "requirements", "hypotheses hold", "contradicted", "with forced steps",
                "evaluations: median, 99%, max",
            ),
            [
                (
                    row.size,
                    row.requirements,
                    row.rate(row.hypotheses_hold),
                    row.contradicted,
                    row.with_forced_steps,
                    ", ".join(f"{number:.0f}" for number in row.evaluations),
                )
                for row in rows
            ],
            "hypotheses hold: rows feasible and V below its limit at every accepted point of the first draw; contradicted: the "
            "hypotheses hold, but the verdict refuses the scene; evaluations: of the guidance (one for each step, refused ones too, and the end), not of the field.",
        )  # fmt: skip

    def complete(self, rows: Sequence[Evaluation]) -> bool:
        """Whether every case was satisfied, and no claim of it refuted."""
        return all(row.satisfied == row.cases and not row.refuted for row in rows)


class AllocationComparison(_EvaluationOfSizes[Comparison]):
    """The three allocations, re-anchored and not, on first draws."""

    row = Comparison
    variants = (ALLOCATIONS, (False, True))

    def _job(self, family: str, size: int, *variant: Any) -> Callable[[], Comparison]:
        options, (allocation, reanchored) = self.options, variant
        return lambda: compare(
            self.field, size, family, options.cases, options.seed,
            allocation=allocation, reanchored=reanchored, drift=few_evaluations(options),
        )  # fmt: skip

    def tables(self, rows: Sequence[Comparison]) -> list[Table]:
        """Success and deviation of each."""
        options = self.options
        return [
            Table(
                f"Tabletop: first draws, {options.cases} cases per row, seed {options.seed}, 95% Wilson intervals",
                ("N", "requirements", "allocation", "re-anchored", "guided, first draw", "deviation"),
                [
                    (
                        row.size,
                        family,
                        row.allocation,
                        "yes" if row.reanchored else "no",
                        row.rate(),
                        f"{row.deviation:.3f}",
                    )
                    for (family, *_), row in zip(self.points, rows, strict=True)
                ],
                "All rows of a size have the same cases and z(0). deviation: RMS distance to the nominal sample, in z, per object.",
            )
        ]  # fmt: skip

    def complete(self, rows: Sequence[Comparison]) -> bool:
        """Always true: allocations other than the default may fail."""
        return True


def evaluation_of(
    field: Field, options: TabletopEvaluate, weights: str | None
) -> SuccessEvaluation | AllocationComparison:
    """The evaluation that the options select.

    Args:
        field: Nominal field.
        options: Of `evaluate`.
        weights: Identifies the field; None for the shipped one.
    """
    settings = {
        **options.settings("tabletop", weights),
        "cases": options.cases,
        "sizes": list(options.sizes),
        "requirements": list(options.requirements),
        "compare": options.compare,
    }
    kind = AllocationComparison if options.compare else SuccessEvaluation
    return kind(field, options, settings)
