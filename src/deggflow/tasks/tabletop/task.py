"""The tabletop task, as the commands see it."""

from collections.abc import Iterator, Sequence
from typing import cast

from deggflow import task
from deggflow.consistency import Line
from deggflow.drift import AbstractDrift
from deggflow.flow import Field

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


class SceneStream(task.AbstractGenerator[SceneCondition, Scene]):
    """Streams of scenes, large ones included."""

    def __init__(self, generator: TabletopGenerator, *, keep_trace: bool) -> None:
        """Args: generator: of scenes; keep_trace: certificates have the whole trace."""
        self.generator, self.keep_trace = generator, keep_trace

    def chunking(self, condition: SceneCondition) -> task.Chunking:
        """Large scenes are generated one by one, as each uses the whole machine."""
        return task.Chunking(1) if is_large(condition) else task.Chunking(concurrent=True)

    def generate(
        self, conditions: Sequence[SceneCondition], run: task.RunSettings, on_status: task.OnStatus
    ) -> Iterator[list[Scene]]:
        """All at once."""
        yield make_scenes(self.generator, conditions, **run._asdict(), keep_trace=self.keep_trace)


def scene_generator(
    field: Field, *, guided: bool = True, drift: AbstractDrift | None = None
) -> TabletopGenerator:
    """The generator of the commands: the default guidance, or none."""
    return TabletopGenerator(field, tabletop_guidance() if guided else None, drift=drift)


class TabletopTask(task.AbstractTask[SceneCondition, Scene]):
    """Task 2 of the paper: arrangements of objects on a table, each easy to reach and use."""

    name = "tabletop"
    noun = "scene"
    sizes = (1, MAX_LARGE)
    options = OPTIONS
    formats = task.Formats(parse_condition, parse_scene, plain, LINES, UNVERIFIED)
    model = TabletopModel()
    processes = TabletopProcesses()

    def random_conditions(
        self, size: int, count: int, first: int, options: task.GenerateOptions
    ) -> list[SceneCondition]:
        """Of the family that --requirements names."""
        family = cast(TabletopGenerate, options).requirements
        return random_conditions(size, count, family, options.seed, first)

    def generator(self, field: Field, options: task.GenerateOptions) -> SceneStream:
        """Scenes with the default guidance, or without any."""
        keep_trace = cast(TabletopGenerate, options).trace
        drift = few_evaluations(options)
        generator = scene_generator(field, guided=options.guided, drift=drift)
        return SceneStream(generator, keep_trace=keep_trace)

    def examine(self, result: Scene, line: Line) -> task.Examination:
        """By exact geometry and by Shapely."""
        verdict = result.verdict()
        return task.Examination.of_verdict(
            holds(result, verdict),
            verdict.reason(result.condition.objects),
            f"{verdict.min_margin:.3g} m",
            contradictions(line),
            result.certificate.table(),
        )

    def evaluation(
        self, field: Field, options: task.EvaluateOptions, weights: str | None
    ) -> SuccessEvaluation | AllocationComparison:
        """Success of nominal and guided scenes, or a comparison of the allocations."""
        options.check_sizes(1, MAX_OBJECTS)
        return evaluation_of(field, cast(TabletopEvaluate, options), weights)
