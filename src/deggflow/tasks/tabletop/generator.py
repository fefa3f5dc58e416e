"""Certified scenes from a nominal field: batches, verdicts and redraws."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from deggflow.certificate import Certificate, GenerationRecord
from deggflow.divergence import REASON
from deggflow.drift import AbstractDrift, AfterPrediction, ExtrapolatedEndpoint, aligned
from deggflow.flow import Field
from deggflow.generation import DEFAULT_STEPS, Generation, refined_grid
from deggflow.guidance import AbstractGuidance, DecoupledGuidance, NoGuidance
from deggflow.recording import records
from deggflow.redraw import Candidate, finished, redraw_until_satisfied, with_draws
from deggflow.sampler import Sampler, masked_sample, numbered_noise
from deggflow.step_guard import StepGuard
from deggflow.task import FieldOptions
from deggflow.task.options import Phase

from .codec import decode_exactly
from .condition import SceneCondition, TabletopCondition, padded_size, take, to_arrays
from .library import MAX_OBJECTS
from .options import TabletopFieldOptions
from .requirements import with_balance
from .scene import Scene
from .settled import judge_generated
from .verdict import Poses

MAX_DRAWS = 8
GUARD = StepGuard(
    halvings=16
)  # V is smooth enough for shorter steps to be accepted, and few scenes need any


def few_evaluations(options: FieldOptions) -> AbstractDrift:
    """The drift that options ask for; docs/guidance.md measures the choices."""
    drift = ExtrapolatedEndpoint(options.evaluations)
    return AfterPrediction(drift) if options.guidance_phase == "after" else drift


def default_drift(
    steps: int = DEFAULT_STEPS, phase: Phase = TabletopFieldOptions.guidance_phase
) -> AbstractDrift:
    """That of the commands, with at most as many evaluations as steps."""
    return few_evaluations(TabletopFieldOptions(min(FieldOptions.evaluations, steps), phase))


def _default_steps(drift: AbstractDrift, guard: StepGuard | None) -> int:
    """Steps of the guidance: guarded ones after a prediction come to the same end with half of them (docs/guidance.md)."""
    few = isinstance(drift, AfterPrediction) and guard is not None
    return DEFAULT_STEPS // 2 if few else DEFAULT_STEPS


class Batch(NamedTuple):
    """One draw of some scenes."""

    z: Float[np.ndarray, "scenes agents 3"]
    poses: list[Float[np.ndarray, "objects 3"]]  # x, y in m, theta in rad
    records: list[GenerationRecord | None]  # of the guidance; None where there was none


def initial_noise(
    seed: int, numbers: Int[np.ndarray, " scenes"], draw_number: int
) -> Float[np.ndarray, "scenes agents 3"]:
    """z(0) of scenes by their number in the run: N(0, I), the same whatever the batch or the guidance."""
    # For every padded size the same numbers.
    return numbered_noise(seed, numbers, draw_number, shape=(MAX_OBJECTS, 3))


def _nobody(number: int, scene: Scene) -> None:
    """Watches no draw."""


class TabletopGenerator:
    """Generates scenes with one field and one guidance; compiled programs are kept between calls."""

    def __init__(
        self,
        field: Field,
        guidance: AbstractGuidance | None = None,
        *,
        steps: int | None = None,
        power: float = 2.0,
        drift: AbstractDrift | None = None,
        guard: StepGuard | None = GUARD,
    ) -> None:
        """One field, one guidance.

        Args:
            field: Nominal field.
            guidance: `NoGuidance()` if None.
            steps: Of `refined_grid`; if None, 50 where guarded guidance acts on the nominal scene, else 100.
            power: Of `refined_grid`.
            drift: How often the field is evaluated, as of `generate`; if None, 16 times, before guidance acts.
            guard: Of guided steps; None: fixed steps.
        """
        self.field, self.steps, self.power = field, steps, power
        if drift is None:
            drift = default_drift() if steps is None else default_drift(steps)
        self.drift = drift.nominal if guidance is None else drift
        self.guidance = NoGuidance() if guidance is None else guidance
        self.guard = None if guidance is None else guard
        steps = _default_steps(self.drift, self.guard) if steps is None else steps
        self.grid = refined_grid(steps, power)
        grid, sampled = self.grid, self.drift
        if guidance is None and isinstance(drift, AfterPrediction):
            # The prediction is the nominal scene already: the points of its path are not needed.
            grid, sampled = refined_grid(1), drift
        self._sampler = Sampler(field, grid, self.guard, drift=sampled)

    def guidance_for(self, condition: SceneCondition) -> AbstractGuidance:
        """The guidance, with the shared requirement on the centre of mass if the condition asks for it."""
        if isinstance(self.guidance, DecoupledGuidance) and condition.balance is not None:
            return with_balance(self.guidance)
        return self.guidance

    def batch(
        self,
        noise: Float[np.ndarray, "scenes agents 3"],
        conditions: Sequence[SceneCondition],
        *,
        keep_trace: bool = False,
    ) -> Batch:
        """One draw of each condition from given z(0); with `keep_trace` the records have the whole trace."""
        agents = padded_size(max(len(c.objects) for c in conditions))
        arrays = to_arrays(conditions, agents)
        z = np.zeros((len(conditions), agents, 3), np.float32)
        by_scene: list[GenerationRecord | None] = [None] * len(conditions)
        for part in _alike(conditions):
            guidance = self.guidance_for(conditions[part[0]])
            draws = self.draw(noise[part, :agents], take(arrays, part), guidance, keep_trace)
            z[part] = draws.z
            if isinstance(guidance, DecoupledGuidance):
                objects = [conditions[number].objects for number in part]
                made = records(draws.summary, guidance.names, objects, draws.trace)
                for number, each in zip(part, made, strict=True):
                    by_scene[number] = each
        poses = [decode_exactly(state, c) for state, c in zip(z, conditions, strict=True)]
        return Batch(z, poses, by_scene)

    def draw(
        self,
        noise: Float[np.ndarray, "scenes agents 3"],
        arrays: TabletopCondition,
        guidance: AbstractGuidance | None = None,
        keep_trace: bool = False,
    ) -> Generation:
        """The compiled program alone, in float32, as numpy arrays, large batches in blocks; nothing decoded or judged."""
        guidance = self.guidance if guidance is None else guidance
        return self._sampler.draw(guidance, noise, arrays, keep_trace=keep_trace)

    def generation(
        self,
        z0: Float[np.ndarray, "agents 3"],
        condition: SceneCondition,
        *,
        keep_trace: bool = False,
    ) -> Generation:
        """The generation of one scene from a given z(0), with z at every grid point."""
        scene = take(to_arrays([condition]), 0)
        guidance, start = self.guidance_for(condition), jnp.asarray(z0[: len(scene.mask)])
        how = self.grid, self.drift, self.guard, keep_trace, True
        return masked_sample(self.field, guidance, start, scene, *how)

    @property
    def taus(self) -> Float[np.ndarray, " points"]:
        """Tau at the points of a path."""
        return np.asarray(aligned(self.grid, self.drift.macro_grid())[0])

    def path(
        self,
        z0: Float[np.ndarray, "agents 3"],
        condition: SceneCondition,
        at: Float[np.ndarray, " points"] | None = None,
    ) -> list[Poses]:
        """Poses of one scene from a given z(0), at every grid point, or at those nearest to `at`.

        A nominal path may have more points than there are steps of the guidance.
        """
        path = self.generation(z0, condition).path
        assert path is not None
        states = np.asarray(path)
        if at is not None:
            states = states[np.abs(self.taus[:, None] - at[None]).argmin(axis=0)]
        return [decode_exactly(state, condition) for state in states]

    def scenes(
        self,
        conditions: Sequence[SceneCondition],
        *,
        seed: int = 0,
        first: int = 0,
        max_draws: int = MAX_DRAWS,
        keep_trace: bool = False,
        on_draw: Callable[[int, Scene], None] = _nobody,
    ) -> list[Scene]:
        """Scenes with certificates; a draw that fails is made again from a new z(0).

        Args:
            conditions: What to generate.
            seed: With a scene's number and the number of the draw, decides z(0).
            first: Number of the first condition in the run.
            max_draws: Limit per scene; where none is satisfied the closest is returned.
            keep_trace: Certificates have the whole trace of V against its bound.
            on_draw: Told of every draw, refused ones too: the scene's number in the run, and the scene as drawn.
        """

        def attempt(index: Sequence[int], number: int) -> list[Candidate[Scene]]:
            subset = [conditions[k] for k in index]
            numbers = np.add(index, first)
            batch = self.batch(initial_noise(seed, numbers, number), subset, keep_trace=keep_trace)
            candidates = judged(batch, subset, seed)
            for one, candidate in zip(numbers, candidates, strict=True):
                on_draw(int(one), with_draws(candidate.sample, number + 1))
            return candidates

        return finished(redraw_until_satisfied(attempt, len(conditions), max_draws))


def _alike(conditions: Sequence[SceneCondition]) -> list[Int[np.ndarray, " _part"]]:
    """Parts of a batch that one guidance takes: those with a shared requirement apart from those without."""
    balanced = np.array([condition.balance is not None for condition in conditions])
    return [group for group in (np.flatnonzero(~balanced), np.flatnonzero(balanced)) if len(group)]


def judged(batch: Batch, conditions: Sequence[SceneCondition], seed: int) -> list[Candidate[Scene]]:
    """Every scene of a batch with its certificate."""
    settled, out = judge_generated(conditions, batch.poses), []
    for k, (verdict, diverged) in enumerate(zip(settled.verdicts, settled.diverged, strict=True)):
        record = batch.records[k]
        reason = verdict.reason(conditions[k].objects)
        if reason is not None and record is not None and record.first_failure is not None:
            reason += f"; on the way {record.first_failure}"
        if diverged:
            reason = REASON
        certificate = Certificate(
            verdict.satisfied and not diverged,
            verdict.min_margin,
            verdict.violation,
            1,
            reason,
            record,
        )
        scene = Scene(conditions[k], settled.poses[k], certificate, seed)
        out.append(Candidate(scene, certificate.satisfied, certificate.min_margin))
    return out
