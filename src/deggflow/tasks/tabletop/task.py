"""The tabletop task, as the commands see it."""

from collections.abc import Iterator, Sequence
from typing import cast

from deggflow.consistency import Line
from deggflow.drift import AbstractDrift
from deggflow.flow import Field
from deggflow.task import (
    AbstractGenerator,
    AbstractTask,
    Chunking,
    Claim,
    EvaluateOptions,
    Examination,
    Formats,
    GenerateOptions,
    OnStatus,
    RunSettings,
    check_range,
)

from .changes import random_conditions
from .condition import SceneCondition
from .consistency import UNVERIFIED, contradictions, holds, plain
from .formats import parse_condition, parse_scene
from .generator import TabletopGenerator, few_evaluations
from .large import is_large, make_scenes
from .library import MAX_LARGE, MAX_OBJECTS
from .lines import LINES
from .model import TabletopModel
from .options import OPTIONS, TabletopEvaluate, TabletopGenerate
from .processes import TabletopProcesses
from .report import AllocationComparison, SuccessEvaluation, evaluation_of
from .requirements import tabletop_guidance
from .scene import Scene


class SceneStream(AbstractGenerator[SceneCondition, Scene]):
    """Streams of scenes, large ones included."""

    def __init__(self, generator: TabletopGenerator, *, keep_trace: bool) -> None:
        """Args: generator: of scenes; keep_trace: certificates have the whole trace."""
        self.generator, self.keep_trace = generator, keep_trace

    def chunking(self, condition: SceneCondition) -> Chunking:
        """Large scenes are generated one by one, as each uses the whole machine."""
        return Chunking(1) if is_large(condition) else Chunking(concurrent=True)

    def generate(
        self, conditions: Sequence[SceneCondition], run: RunSettings, on_status: OnStatus
    ) -> Iterator[list[Scene]]:
        """All at once."""
        yield make_scenes(self.generator, conditions, **run._asdict(), keep_trace=self.keep_trace)


def scene_generator(
    field: Field, *, guided: bool = True, drift: AbstractDrift | None = None
) -> TabletopGenerator:
    """The generator of the commands: the default guidance, or none."""
    return TabletopGenerator(field, tabletop_guidance() if guided else None, drift=drift)


class TabletopTask(AbstractTask[SceneCondition, Scene]):
    """Task 2 of the paper: arrangements of objects on a table, each easy to reach and use."""

    name = "tabletop"
    noun = "scene"
    sizes = (1, MAX_LARGE)
    options = OPTIONS
    formats = Formats(parse_condition, parse_scene, plain, LINES, UNVERIFIED)
    claim = Claim("scene satisfies every requirement", "scenes satisfy every requirement")
    model = TabletopModel()
    processes = TabletopProcesses()

    def random_conditions(
        self, size: int, count: int, first: int, options: GenerateOptions
    ) -> list[SceneCondition]:
        """Of the family that --requirements names."""
        family = cast(TabletopGenerate, options).requirements
        return random_conditions(size, count, family, options.seed, first)

    def generator(self, field: Field, options: GenerateOptions) -> SceneStream:
        """Scenes with the default guidance, or without any."""
        keep_trace = cast(TabletopGenerate, options).trace
        drift = few_evaluations(options)
        generator = scene_generator(field, guided=options.guided, drift=drift)
        return SceneStream(generator, keep_trace=keep_trace)

    def examine(self, result: Scene, line: Line) -> Examination:
        """By exact geometry and by Shapely."""
        verdict = result.verdict()
        good = holds(result, verdict)
        reason = verdict.reason(result.condition.objects)
        text = "now it holds" if good else f"now it does NOT hold: {reason}"
        return Examination(
            good,
            f"{text} (least margin {verdict.min_margin:.3g} m)",
            contradictions(line),
            result.certificate.table(),
        )

    def evaluation(
        self, field: Field, options: EvaluateOptions, weights: str | None
    ) -> SuccessEvaluation | AllocationComparison:
        """Success of nominal and guided scenes, or a comparison of the allocations."""
        for size in options.sizes:
            check_range("sizes", size, 1, MAX_OBJECTS)
        return evaluation_of(field, cast(TabletopEvaluate, options), weights)
