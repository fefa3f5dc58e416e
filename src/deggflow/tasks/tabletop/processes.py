"""Each object of a scene as a process of its own."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from deggflow.drift import AbstractDrift
from deggflow.flow import Field
from deggflow.guidance import DecoupledGuidance
from deggflow.jsonl import InputError
from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.runtime import TeamGeneration, TeamProgram, compile_agent, run_agent
from deggflow.step_guard import StepGuard
from deggflow.task import RunSettings
from deggflow.task.processes import AbstractAgent, AgentFactory, Link, Made

from .codec import decode_exactly
from .condition import SceneCondition, padded_size, take, to_arrays
from .generator import Batch, TabletopGenerator, few_evaluations, initial_noise, judged
from .large import is_large
from .options import TabletopGenerate
from .requirements import tabletop_guidance
from .scene import Scene, finished


class ObjectAgent(AbstractAgent[SceneCondition]):
    """The process of one object; a scene is drawn again as all of its objects find by themselves that it has to be."""

    def __init__(self, generator: TabletopGenerator, link: Link, *, keep_trace: bool) -> None:
        """Args: generator: its field, guidance and steps; link: to the others; keep_trace: of certificates."""
        self._generator, self._link, self._keep_trace = generator, link, keep_trace
        self._programs: dict[tuple[str, ...], TeamProgram] = {}

    def make(self, condition: SceneCondition, run: RunSettings) -> Made | None:
        """As `TabletopGenerator.scenes`; a scene on the way of which an object was lost is not drawn again."""
        if self._link.number >= len(condition.objects):
            return None
        lost: frozenset[int] = frozenset()

        def attempt(_: Sequence[int], draw: int) -> list[Candidate[Scene]]:
            nonlocal lost
            made = self._generate(condition, run, draw)
            lost = frozenset(np.flatnonzero(np.isfinite(made.stops)).tolist())
            (candidate,) = judged(self._batch(made, condition), [condition], run.seed)
            return [replace(candidate, satisfied=candidate.satisfied or bool(lost))]

        (scene,) = finished(redraw_until_satisfied(attempt, 1, run.max_draws))
        return Made(scene, lost)

    def _generate(self, condition: SceneCondition, run: RunSettings, draw: int) -> TeamGeneration:
        arrays = take(to_arrays([condition]), 0)
        program = self._program(cast(DecoupledGuidance, self._generator.guidance_for(condition)))
        noise = initial_noise(run.seed, np.array([run.first]), draw)[0]
        start = program.start(noise[: padded_size(len(condition.objects))], arrays, arrays.mask)
        link = self._link
        if draw == 0:
            with link.compiling():
                compile_agent(program, link.number, start)
        return run_agent(
            program, link.number, start, link.transport,
            faults=link.faults_of(len(condition.objects)), timing=link.timing,
            greet=draw == 0, on_round=link.on_round,
        )  # fmt: skip

    def _program(self, guidance: DecoupledGuidance) -> TeamProgram:
        if guidance.names not in self._programs:
            made, guard = self._generator, cast(StepGuard, self._generator.guard)
            self._programs[guidance.names] = TeamProgram(
                made.field, guidance, grid=made.grid, drift=made.drift, guard=guard,
                keep_trace=self._keep_trace,
            )  # fmt: skip
        return self._programs[guidance.names]

    def _batch(self, made: TeamGeneration, condition: SceneCondition) -> Batch:
        z = np.asarray(made.generation.z)[None]
        guidance = cast(DecoupledGuidance, self._generator.guidance_for(condition))
        record = made.record(guidance.names, condition.objects)
        return Batch(z, [decode_exactly(z[0], condition)], [record])


class TabletopProcesses(AgentFactory):
    """Objects as processes."""

    def team_size(self, condition: SceneCondition) -> int:
        """How many objects a scene has; raises `InputError` for a large scene."""
        if is_large(condition):
            raise InputError(
                f"--processes takes scenes on the paper's table; got one of {len(condition.objects)} objects"
            )
        return len(condition.objects)

    def agent(self, field: Field, options: Any, link: Link) -> ObjectAgent:
        """An object with its copy of the field and the commands' guidance."""
        settings = cast(TabletopGenerate, options)
        drift: AbstractDrift = few_evaluations(settings)
        generator = TabletopGenerator(field, tabletop_guidance(), drift=drift)
        return ObjectAgent(generator, link, keep_trace=settings.trace)
