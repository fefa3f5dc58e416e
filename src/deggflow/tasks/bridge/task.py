"""The bridge task, as the commands see it."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

from deggflow import task
from deggflow.consistency import Line
from deggflow.drift import AbstractDrift
from deggflow.flow import Field

from .condition import TrialCondition
from .consistency import UNVERIFIED, contradictions, plain
from .field import BridgeField
from .formats import parse_condition, parse_trial
from .generator import BridgeGenerator, Round
from .lines import LINES
from .model import BridgeModel
from .options import OPTIONS, BridgeEvaluate, BridgeGenerate
from .oracle import fastest_contact, refutation
from .policies import few_evaluations
from .processes import BridgeProcesses
from .report import HardEvaluation, ModesEvaluation, SuccessEvaluation, evaluation_of
from .requirements import bridge_guidance
from .scenes import random_conditions
from .trial import Trial
from .world import MAX_ROBOTS, MIN_ROBOTS


class TrialStream(task.AbstractGenerator[TrialCondition, Trial]):
    """Trials, yielded as soon as they and all earlier ones are over."""

    def __init__(self, generator: BridgeGenerator) -> None:
        """Args: generator: of trials."""
        self.generator = generator

    def chunking(self, condition: TrialCondition) -> task.Chunking:
        """All trials of a chunk advance together."""
        return task.Chunking()

    def generate(
        self, conditions: Sequence[TrialCondition], run: task.RunSettings, on_status: task.OnStatus
    ) -> Iterator[list[Trial]]:
        """As `BridgeGenerator.stream`."""

        def tell(current: Round) -> None:
            on_status(f"policy {current.policy + 1}, {len(current.trials)} trials under way")

        return self.generator.stream(conditions, **run._asdict(), on_round=tell)


def trial_generator(
    field: BridgeField,
    *,
    guided: bool = True,
    speed_limit: float | None = None,
    drift: AbstractDrift | None = None,
) -> BridgeGenerator:
    """The generator of the commands: the default guidance, with a speed limit in m/s if there is one, or none."""
    if not guided:
        return BridgeGenerator(field, drift=drift)
    guidance = bridge_guidance(field.scales, speed_limit=speed_limit)
    return BridgeGenerator(field, guidance, drift=drift, speed_limit=speed_limit)


class _Replayed(NamedTuple):
    """Results of one trial, for the totals of `certify`."""

    refuted: bool
    fastest: float  # m/s, of a contact point


class BridgeTask(task.AbstractTask[TrialCondition, Trial]):
    """Task 1 of the paper: robots push a plank over a gap and cross it."""

    name = "bridge"
    noun = "trial"
    sizes = (MIN_ROBOTS, MAX_ROBOTS)
    options = OPTIONS
    formats = task.Formats(parse_condition, parse_trial, plain, LINES, UNVERIFIED)
    claim = task.Claim("trial bridges the gap", "trials bridge the gap")
    model = BridgeModel()
    processes = BridgeProcesses()

    def random_conditions(
        self, size: int, count: int, first: int, options: task.GenerateOptions
    ) -> list[TrialCondition]:
        """As `scenes.random_conditions`."""
        return random_conditions(size, count, options.seed, first)

    def generator(self, field: Field, options: task.GenerateOptions) -> TrialStream:
        """Trials with the default guidance and a speed limit, or without any."""
        limit = cast(BridgeGenerate, options).speed_limit
        return TrialStream(
            trial_generator(
                cast(BridgeField, field),
                guided=options.guided,
                speed_limit=limit,
                drift=few_evaluations(options),
            )
        )

    def fails(self, row: Line, *, guided: bool) -> bool:
        """Whether the gap is not bridged, or a guided trial has no certificate that holds."""
        return (guided and not row["certificate"]["satisfied"]) or not row["outcome"]["success"]

    def examine(self, result: Trial, line: Line) -> task.Examination:
        """By an independent integrator and Shapely."""
        refuted = refutation(line)
        wrong = contradictions(line)
        text = "the replay agrees" if refuted is None else f"the replay finds that {refuted}"
        return task.Examination(
            result.success and refuted is None,
            text,
            wrong,
            result.certificate.table(),
            _Replayed(refuted is not None, fastest_contact(line)),
        )

    def conclude(self, examinations: Sequence[task.Examination]) -> str:
        """Numbers of successes and refutations, and the largest speed."""
        bridged = sum(each.holds for each in examinations)
        refuted = sum(each.detail.refuted or bool(each.wrong) for each in examinations)
        fastest = max((each.detail.fastest for each in examinations), default=0.0)
        return (
            f"{bridged} of {len(examinations)} trials bridge the gap; the replay refutes what {refuted} say; "
            f"the fastest contact point moved at {fastest:.3f} m/s."
        )

    def evaluation(
        self, field: Field, options: task.EvaluateOptions, weights: str | None
    ) -> SuccessEvaluation | HardEvaluation | ModesEvaluation:
        """Success and policies; or hard states; or the sides on which planks pass."""
        options.check_sizes(MIN_ROBOTS, MAX_ROBOTS)
        return evaluation_of(cast(BridgeField, field), cast(BridgeEvaluate, options), weights)
