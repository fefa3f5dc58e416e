"""What `deggflow bridge evaluate` measures and prints."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, TypeVar

from deggflow.statistics import Row
from deggflow.task import AbstractEvaluation, Table

from .evaluate import SOURCES, Evaluation, Modes, Passes, count_modes, evaluate, passes
from .field import BridgeField
from .hard import HardPolicies, blocked_texts, evaluate_hard
from .options import BridgeEvaluate
from .policies import few_evaluations

R = TypeVar("R", bound=Row)

_FAILURES = {
    "plank_leaves": "plank leaves",
    "support_lost": "plank loses support",
    "robot_leaves": "robot leaves",
    "robot_in_gap": "robot in the gap",
    "time_out": "timeout",
    "other": "other",
}


class _EvaluationOfSizes(AbstractEvaluation[R]):
    """What is measured for each size.

    Attributes:
        counted: The option that says how many are measured.
        measure: Measures one size.
    """

    counted: str
    measure: Callable[[BridgeField, int, BridgeEvaluate], R]

    def __init__(
        self, field: BridgeField, options: BridgeEvaluate, settings: Mapping[str, Any]
    ) -> None:
        """Args: as of `evaluation_of`."""
        self.options = options
        count, sizes = getattr(options, self.counted), list(options.sizes)
        self.settings = {**settings, self.counted: count, "sizes": sizes}
        self.jobs = [partial(self.measure, field, size, options) for size in sizes]


class SuccessEvaluation(_EvaluationOfSizes[Evaluation]):
    """Nominal and guided trials of each size."""

    row = Evaluation
    counted = "trials"
    measure = staticmethod(evaluate)

    def tables(self, rows: Sequence[Evaluation]) -> list[Table | str]:
        """Success, failures of nominal trials, policies, and blocked or refuted trials."""
        texts = {
            "Guided trials that do not bridge the gap:": [t for row in rows for t in row.blocked],
            "Outcomes that the replay refutes:": [t for row in rows for t in row.refuted],
        }
        return [
            self._success(rows),
            _nominal_failures(rows),
            self._policies(rows),
            *(
                "\n".join([heading, *(f"- {text}" for text in some)])
                for heading, some in texts.items()
                if some
            ),
        ]

    def _success(self, rows: Sequence[Evaluation]) -> Table:
        counted = f"{self.options.trials} trials per row, seed {self.options.seed}"
        return Table(
            f"Bridge: success, {counted}, 95% Wilson intervals",
            ("N", "nominal", "guided", "blocked", "least margin", "refuted"),
            [
                (
                    row.size,
                    row.rate(row.nominal),
                    row.rate(row.guided),
                    len(row.blocked),
                    f"{1000 * row.least_margin:.0f} mm",
                    len(row.refuted),
                )
                for row in rows
            ],
            "Nominal and guided trials have the same starts and z(0). blocked: guided trials that do not bridge the gap; "
            "least margin: smallest distance to any failure over all executed guided motions; refuted: outcomes, nominal "
            "or guided, that a replay by Shapely found false.",
        )

    def _policies(self, rows: Sequence[Evaluation]) -> Table:
        pairs = [(row, row.policies["nominal"], row.policies["guided"]) for row in rows]
        return Table(
            "Bridge: policies that end with q_task and q_safe below their bounds",
            (
                "N", "nominal policies", "both met", "guided policies", "both met, first draw",
                f"both met, <= {self.options.max_draws} draws", "most draws",
            ),
            [
                (
                    row.size,
                    nominal.generated,
                    nominal.rate(nominal.met) if nominal.generated else "-",
                    guided.generated,
                    guided.rate(guided.met_at_once) if guided.generated else "-",
                    guided.rate(guided.met) if guided.generated else "-",
                    guided.most_draws,
                )
                for row, nominal, guided in pairs
            ],
        )  # fmt: skip

    def complete(self, rows: Sequence[Evaluation]) -> bool:
        """Whether every guided trial bridges the gap, and no outcome is refuted."""
        return all(row.guided == row.trials and not row.refuted for row in rows)


def _nominal_failures(rows: Sequence[Evaluation]) -> Table:
    return Table(
        "Bridge: failures of nominal trials",
        ("N", "failures", *_FAILURES.values()),
        [
            (row.size, row.trials - row.nominal, *(row.failures[kind] for kind in _FAILURES))
            for row in rows
        ],
    )


class HardEvaluation(_EvaluationOfSizes[HardPolicies]):
    """Guided policies from hard states."""

    row = HardPolicies
    counted = "hard"
    measure = staticmethod(evaluate_hard)

    def tables(self, rows: Sequence[HardPolicies]) -> list[Table | str]:
        """Outcomes of the policies, and the reasons of refusals."""
        options = self.options
        table = Table(
            f"Bridge: guided policies from hard states, {options.hard} per row, seed {options.seed}, 95% Wilson intervals",
            (
                "N", "first draw met", f"accepted, <= {options.max_draws} draws", "above a bound",
                "refuted", "hypotheses hold", "with forced steps", "largest rejected excess",
            ),
            [
                (
                    row.size,
                    row.rate(row.met_at_once),
                    row.rate(row.accepted),
                    row.missed,
                    row.refuted,
                    row.rate(row.hypotheses_hold),
                    row.with_forced_steps,
                    f"{row.excess:.3g}",
                )
                for row in rows
            ],
            "Hard states: at most 0.1 m inside or outside the factors' buffers to a wall, to the gap or to lost support; three "
            "of four states are in motion. above a bound: accepted, although q_task or q_safe ends above its bound in float64; "
            "refuted: accepted, although Shapely finds a violation during execution; hypotheses hold: accepted, and they hold at "
            "every point of the generation; with forced steps: accepted, with a forced step during the generation; largest "
            "rejected excess: largest excess of a factor over its bound among rejected policies.",
        )  # fmt: skip
        blocked = blocked_texts(rows)
        text = "\n".join(["No draw was accepted and the team stops:", *blocked])
        return [table, *([text] if blocked else [])]

    def complete(self, rows: Sequence[HardPolicies]) -> bool:
        """Whether no accepted policy misses a bound or is refuted."""
        return not any(row.missed or row.refuted for row in rows)


class ModesEvaluation(AbstractEvaluation[Modes]):
    """On which side planks pass from one symmetric start: demonstrations, nominal, guided."""

    row = Modes

    def __init__(
        self, field: BridgeField, options: BridgeEvaluate, settings: Mapping[str, Any]
    ) -> None:
        """Args: as of `evaluation_of`."""
        self.options = options
        self.settings = {**settings, "modes": options.modes}
        self.jobs = [self._job(source) for source in SOURCES]
        # A figure shows the trials that the rows count.
        self.paths: Callable[[str], list[Passes]] = cache(
            lambda source: passes(
                field,
                source,
                options.modes,
                options.seed,
                options.max_draws,
                few_evaluations(options),
            )
        )

    def _job(self, source: str) -> Callable[[], Modes]:
        return lambda: count_modes(source, self.paths(source))

    def tables(self, rows: Sequence[Modes]) -> list[Table]:
        """Sides, and distances."""
        options = self.options
        return [
            Table(
                f"Bridge: sides of passage, {options.modes} from one symmetric start, seed {options.seed}, 95% Wilson intervals",
                (
                    "source",
                    "bridged",
                    "left",
                    "right",
                    "farthest from the middle: 5%",
                    "median",
                    "95%",
                ),
                [
                    (
                        row.source,
                        row.rate(row.bridged),
                        row.rate(row.left),
                        row.rate(row.trials - row.left),
                        *(f"{value:.2f} m" for value in (row.low, row.median, row.high)),
                    )
                    for row in rows
                ],
                "left, right: side on which the plank's centre is farthest from the straight line between start and goal; "
                "farthest from the middle: that distance.",
            )
        ]

    def complete(self, rows: Sequence[Modes]) -> bool:
        """Always true: the counts make no promise."""
        return True


def evaluation_of(
    field: BridgeField, options: BridgeEvaluate, weights: str | None
) -> SuccessEvaluation | HardEvaluation | ModesEvaluation:
    """The evaluation that the options select.

    Args:
        field: Nominal field.
        options: Of `evaluate`.
        weights: Identifies the field; None for the shipped one.
    """
    settings = options.settings("bridge", weights)
    if options.hard:
        return HardEvaluation(field, options, settings)
    if options.modes:
        return ModesEvaluation(field, options, settings)
    return SuccessEvaluation(field, options, settings)
