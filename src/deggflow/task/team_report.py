"""`evaluate` of a team task: success of nominal and guided samples, with every claim checked by the task's oracle."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deggflow.flow import Field
from deggflow.statistics import SuccessRow

from .interface import AbstractEvaluation, RunSettings, Table
from .options import EvaluateOptions, GenerateOptions, check_range
from .team_sample import TeamSample

if TYPE_CHECKING:
    from .team import AbstractTeamTask


@dataclass(frozen=True)
class TeamOptions(EvaluateOptions):
    """What to measure.

    Attributes:
        cases: Random cases of each size.
    """

    cases: int = 200

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("cases", self.cases, 1, 1_000_000)


@dataclass(frozen=True)
class TeamEvaluation(SuccessRow):
    """Counts for one size, with the least margin by the oracle."""


class TeamSuccess(AbstractEvaluation[TeamEvaluation]):
    """Success of nominal and guided samples for each size."""

    row = TeamEvaluation

    def __init__(
        self, task: "AbstractTeamTask", field: Field, options: TeamOptions, weights: str | None
    ) -> None:
        """Args: as for `AbstractTask.evaluation`."""
        self._task, self._field, self._options = task, field, options
        self.settings: Mapping[str, Any] = {
            **options.settings(task.name, weights),
            "cases": options.cases,
            "sizes": list(options.sizes),
        }
        self.jobs = [self._job(size) for size in options.sizes]

    def _job(self, size: int) -> Callable[[], TeamEvaluation]:
        return lambda: self._measure(size)

    def _samples(self, size: int, *, guided: bool) -> list[TeamSample]:
        options = self._options
        generation = GenerateOptions(seed=options.seed, guidance="degg" if guided else "none")
        conditions = self._task.random_conditions(size, options.cases, 0, generation)
        run = RunSettings(options.seed, max_draws=options.max_draws if guided else 1)
        (samples,) = self._task.generator(self._field, generation).generate(
            conditions, run, on_status=lambda status: None
        )
        return samples

    def _measure(self, size: int) -> TeamEvaluation:
        nominal, guided = (self._samples(size, guided=guided) for guided in (False, True))
        claims = [sample for sample in guided if _satisfied(sample)]
        margins = [self._task.least_margin(each.condition, each.states) for each in claims]
        return TeamEvaluation(
            size,
            self._options.cases,
            nominal=sum(map(_satisfied, nominal)),
            first_draw=sum(_draws(each) == 1 for each in claims),
            satisfied=len(claims),
            most_draws=max(map(_draws, guided)),
            least_margin=min(margins, default=None),
            refuted=sum(not margin >= -self._task.tolerance for margin in margins),
        )

    def tables(self, rows: Sequence[TeamEvaluation]) -> list[Table]:
        """A table of success by size."""
        options = self._options
        return [
            Table(
                f"{self._task.name.capitalize()}: success, {options.cases} cases per row, seed {options.seed}, "
                "95% Wilson intervals",
                (
                    "N", "nominal", "guided, first draw", f"guided, <= {options.max_draws} draws",
                    "most draws", "least margin", "refuted",
                ),
                [
                    (
                        row.size,
                        row.rate(row.nominal),
                        row.rate(row.first_draw),
                        row.rate(row.satisfied),
                        row.most_draws,
                        row.margin_text,
                        row.refuted,
                    )
                    for row in rows
                ],
                "Nominal and guided samples have the same conditions and z(0). refuted: claims of success that the oracle found false.",
            )
        ]  # fmt: skip

    def complete(self, rows: Sequence[TeamEvaluation]) -> bool:
        """Whether every case was satisfied, and no claim refuted."""
        return all(row.complete for row in rows)


def _satisfied(sample: TeamSample) -> bool:
    return sample.certificate is not None and sample.certificate.satisfied


def _draws(sample: TeamSample) -> int:
    return 0 if sample.certificate is None else sample.certificate.draws
