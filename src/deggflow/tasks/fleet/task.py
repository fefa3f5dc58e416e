"""The fleet, as the commands see it."""

from collections.abc import Iterator, Sequence
from typing import cast

from deggflow import task
from deggflow.consistency import Line
from deggflow.flow import Field

from .condition import MAX_ROBOTS, MIN_ROBOTS, FleetCondition
from .consistency import UNVERIFIED, contradictions, holds, plain
from .drawn import random_conditions
from .floor_files import read_floor
from .formats import parse_condition, parse_plan
from .generator import FleetGenerator
from .lines import LINES
from .model import FleetModel
from .options import OPTIONS, FleetEvaluate, FleetGenerate
from .plan import Plan
from .report import SuccessEvaluation


class PlanStream(task.AbstractGenerator[FleetCondition, Plan]):
    """Streams of plans."""

    def __init__(self, generator: FleetGenerator) -> None:
        """Args: generator: of plans."""
        self.generator = generator

    def chunking(self, condition: FleetCondition) -> task.Chunking:
        """Plans of a chunk are generated together."""
        return task.Chunking(concurrent=True)

    def generate(
        self, conditions: Sequence[FleetCondition], run: task.RunSettings, on_status: task.OnStatus
    ) -> Iterator[list[Plan]]:
        """All at once."""
        yield self.generator.plans(conditions, **run._asdict())


class FleetTask(task.AbstractTask[FleetCondition, Plan]):
    """Disc robots share a floor: each goes from its start to its goal, clear of obstacles and of each other."""

    name = "fleet"
    noun = "plan"
    sizes = (MIN_ROBOTS, MAX_ROBOTS)
    options = OPTIONS
    formats = task.Formats(parse_condition, parse_plan, plain, LINES, UNVERIFIED)
    model = FleetModel()

    def random_conditions(
        self, size: int, count: int, first: int, options: task.GenerateOptions
    ) -> list[FleetCondition]:
        """On the map and by the scheme that the options name."""
        fleet = cast(FleetGenerate, options)
        floor = None if fleet.floor is None else read_floor(fleet.floor)
        return random_conditions(
            size, count, fleet.map, fleet.scheme, options.seed, first, own_floor=floor
        )

    def generator(self, field: Field, options: task.GenerateOptions) -> PlanStream:
        """Plans with the default guidance, or without any."""
        return PlanStream(
            FleetGenerator(field, cast(FleetGenerate, options), guided=options.guided)
        )

    def examine(self, result: Plan, line: Line) -> task.Examination:
        """In closed form, by Shapely, and at many moments."""
        verdict = result.verdict()
        return task.Examination.of_verdict(
            holds(result, verdict),
            verdict.reason(),
            f"{verdict.min_margin:.3g} map units",
            contradictions(line),
            result.certificate.table(),
        )

    def evaluation(
        self, field: Field, options: task.EvaluateOptions, weights: str | None
    ) -> SuccessEvaluation:
        """Success of nominal and guided plans."""
        options.check_sizes(MIN_ROBOTS, MAX_ROBOTS)
        return SuccessEvaluation(field, cast(FleetEvaluate, options), weights)
