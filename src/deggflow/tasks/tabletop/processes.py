"""Each object of a scene as a process of its own, or each part of a large scene."""

import abc
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from deggflow.drift import AbstractDrift
from deggflow.flow import Field
from deggflow.guidance import DecoupledGuidance
from deggflow.jsonl import InputError
from deggflow.redraw import Candidate, finished, redraw_until_satisfied
from deggflow.runtime import (
    DirectTransport,
    Exchange,
    PartProgram,
    PartStart,
    TeamGeneration,
    TeamProgram,
    compile_agent,
    compile_part,
    owners_of,
    run_agent,
    run_part,
)
from deggflow.step_guard import StepGuard
from deggflow.task import RunSettings
from deggflow.task.processes import AbstractAgent, AgentFactory, Link, Made

from .codec import decode_exactly
from .condition import SceneCondition, padded_size, take, to_arrays
from .generator import Batch, TabletopGenerator, few_evaluations, initial_noise, judged
from .large import LargeSceneGenerator, is_large, large_scene_guidance, large_scenes_like
from .large.condition import decode_exactly as large_decode_exactly
from .large.condition import to_arrays as large_arrays
from .large.field import large_scene_field
from .large.generator import BESIDE, CROWDS, HEARD
from .large.generator import initial_noise as large_noise
from .large.parts import ObjectNeighbourhood
from .options import TabletopGenerate
from .requirements import tabletop_guidance
from .scene import Scene
from .verdict import BUFFER

MOST_OBJECTS = 1000
"""Of a large scene in one process: what it says of them in the end fits into a datagram."""


class _Drawn(NamedTuple):
    """A scene as drawn, and the numbers of the objects that were lost on the way."""

    batch: Batch
    lost: frozenset[int]


class _AbstractSceneAgent(AbstractAgent[SceneCondition]):
    """A process that draws scenes with others; all find by themselves whether a scene has to be drawn again."""

    @abc.abstractmethod
    def draw(
        self, condition: SceneCondition, run: RunSettings, draw: int, before: _Drawn | None
    ) -> _Drawn:
        """A draw of the scene number `run.first`, and the one before, if any: objects that were lost in it stay."""

    def make(self, condition: SceneCondition, run: RunSettings) -> Made | None:
        """As `TabletopGenerator.scenes`."""
        drawn: _Drawn | None = None

        def attempt(_: Sequence[int], draw: int) -> list[Candidate[Scene]]:
            nonlocal drawn
            drawn = self.draw(condition, run, draw, drawn)
            return judged(drawn.batch, [condition], run.seed)

        (scene,) = finished(redraw_until_satisfied(attempt, 1, run.max_draws))
        assert drawn is not None
        return Made(scene, drawn.lost)


class ObjectAgent(_AbstractSceneAgent):
    """The process of one object."""

    def __init__(self, generator: TabletopGenerator, link: Link, *, keep_trace: bool) -> None:
        """Args: generator: its field, guidance and steps; link: to the others; keep_trace: of certificates."""
        self._generator, self._link, self._keep_trace = generator, link, keep_trace
        self._programs: dict[tuple[str, ...], TeamProgram] = {}

    def make(self, condition: SceneCondition, run: RunSettings) -> Made | None:
        """None in a scene that has no object of this number."""
        if self._link.number >= len(condition.objects):
            return None
        return super().make(condition, run)

    def draw(
        self, condition: SceneCondition, run: RunSettings, draw: int, before: _Drawn | None
    ) -> _Drawn:
        """With a process for every object; in another draw, those that were lost are obstacles where they stopped."""
        made = self._generate(condition, run, draw, before)
        lost = frozenset(np.flatnonzero(np.isfinite(made.stops)).tolist())
        return _Drawn(self._batch(made, condition), lost)

    def _generate(
        self, condition: SceneCondition, run: RunSettings, draw: int, before: _Drawn | None
    ) -> TeamGeneration:
        arrays = take(to_arrays([condition]), 0)
        program = self._program(cast(DecoupledGuidance, self._generator.guidance_for(condition)))
        z0 = initial_noise(run.seed, np.array([run.first]), draw)[0]
        z0 = z0[: padded_size(len(condition.objects))].copy()
        lost = [] if before is None else sorted(before.lost)
        if before is not None:
            z0[lost] = before.batch.z[0, lost]
        start = program.start(z0, arrays, arrays.mask, lost)
        link = self._link
        if draw == 0:
            with link.compiling():
                compile_agent(program, link.number, start)
        return run_agent(
            program, link.number, start, link.transport,
            faults=max(link.faults_of(len(condition.objects)) - len(lost), 0), timing=link.timing,
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


class PartAgent(_AbstractSceneAgent):
    """The process of some objects of a large scene, which is told the states of its neighbours alone."""

    def __init__(
        self, generator: LargeSceneGenerator, link: Link, processes: int, *, keep_trace: bool
    ) -> None:
        """Args: generator: its field, guidance and steps; link: to the others; processes: how many share the scene; keep_trace: of certificates."""
        self._generator, self._link, self._processes = generator, link, processes
        self._keep_trace = keep_trace
        transport = cast(DirectTransport, link.transport)
        self._exchange = Exchange(link.number, processes, transport, link.timing, link.on_round)
        self._programs: dict[int, PartProgram] = {}

    def draw(
        self, condition: SceneCondition, run: RunSettings, draw: int, before: _Drawn | None
    ) -> _Drawn:
        """With room for as many neighbours as there are, as `LargeSceneGenerator.batch`."""
        z0 = large_noise(condition, run.seed, run.first, draw)
        arrays, count = (
            jax.tree.map(jnp.asarray, large_arrays(condition, BUFFER)),
            len(condition.objects),
        )
        owners = np.full(len(z0), -1)
        owners[:count] = owners_of(count, self._processes)
        for crowd in CROWDS:
            program, start = self._program(crowd), PartStart(self._link.number, owners, z0, arrays)
            with self._link.compiling():
                compile_part(program, start)
            made = run_part(program, start, self._exchange, patience=self._link.timing.join)
            if np.isfinite(made.generation.z).all():
                break
        z, record = (
            np.asarray(made.generation.z),
            made.record(program.guidance.names, condition.objects),
        )
        batch = Batch(z[None], [large_decode_exactly(z, condition)], [record])
        return _Drawn(batch, frozenset())

    def _program(self, crowd: int) -> PartProgram:
        if crowd not in self._programs:
            made = self._generator
            self._programs[crowd] = PartProgram(
                large_scene_field(made.field, HEARD * crowd),
                large_scene_guidance(BESIDE * crowd),
                ObjectNeighbourhood(2 * BESIDE * crowd),
                grid=made.grid,
                drift=made.drift,
                guard=cast(StepGuard, made.guard),
                keep_trace=self._keep_trace,
            )
        return self._programs[crowd]


class TabletopProcesses(AgentFactory):
    """Objects as processes, or parts of a large scene."""

    def team_size(self, condition: SceneCondition, options: Any) -> int:
        """How many processes a scene has; raises `InputError` for a large scene without their number, and a small one with it."""
        processes, count = cast(TabletopGenerate, options).processes, len(condition.objects)
        if not is_large(condition):
            if processes:
                raise InputError(
                    f"--processes with a number takes large scenes; leave out {processes} for a scene of {count} objects"
                )
            return count
        if not processes:
            raise InputError(
                f"--processes takes scenes on the paper's table; a large one of {count} objects needs a number, such as --processes 8"
            )
        if not processes <= count <= MOST_OBJECTS * processes:
            raise InputError(
                f"--processes must give each process 1 to {MOST_OBJECTS} of the {count} objects; got {processes} processes"
            )
        if condition.balance is not None:
            raise InputError(
                "--processes with a number takes scenes without a balance, which depends on all objects"
            )
        return processes

    def agent(self, field: Field, options: Any, link: Link) -> _AbstractSceneAgent:
        """An object, or a part of a large scene, with its copy of the field and the commands' guidance."""
        settings = cast(TabletopGenerate, options)
        drift: AbstractDrift = few_evaluations(settings)
        generator = TabletopGenerator(field, tabletop_guidance(), drift=drift)
        if not settings.processes:
            return ObjectAgent(generator, link, keep_trace=settings.trace)
        large = large_scenes_like(generator)
        return PartAgent(large, link, settings.processes, keep_trace=settings.trace)
