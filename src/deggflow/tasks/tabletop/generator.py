"""Certified scenes from a nominal field: batches, verdicts and redraws."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.blocks import blocks, map_blocks, padded_batch
from deggflow.certificate import Certificate, GenerationRecord
from deggflow.divergence import REASON
from deggflow.flow import Field
from deggflow.generation import DEFAULT_STEPS, generate, generate_batch, refined_grid
from deggflow.guidance import AbstractGuidance, DecoupledGuidance, NoGuidance
from deggflow.recording import record
from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.step_guard import StepGuard
from deggflow.trace import Summary, Trace

from .codec import decode_exactly
from .condition import SceneCondition, TabletopCondition, padded_size, take, to_arrays
from .library import MAX_OBJECTS
from .requirements import with_balance
from .scene import Scene, finished, with_draws
from .settled import judge_generated
from .verdict import Poses

MAX_DRAWS = 8
GUARD = StepGuard()


class Batch(NamedTuple):
    """One draw of some scenes."""

    z: Float[np.ndarray, "scenes agents 3"]
    poses: list[Float[np.ndarray, "objects 3"]]  # x, y in m, theta in rad
    records: list[GenerationRecord | None]  # of the guidance; None where there was none


class _Drawn(NamedTuple):
    """What the compiled program hands out."""

    z: Float[Array, "scenes agents 3"]
    summary: Summary  # each leaf with a leading axis of scenes
    trace: Trace | None


def _generated(
    field: Field,
    guidance: AbstractGuidance,
    noise: Float[Array, "scenes agents 3"],
    condition: TabletopCondition,
    grid: Float[Array, " points"],
    guard: StepGuard | None,
    keep_trace: bool,
) -> _Drawn:
    out = generate_batch(
        field, guidance, noise, condition, grid=grid, guard=guard, mask=condition.mask,
        keep_trace=keep_trace,
    )  # fmt: skip
    return _Drawn(out.z, out.summary, out.trace)


_program = eqx.filter_jit(_generated)


@jax.jit
def _noise(
    seed: Int[Array, ""], numbers: Int[Array, " scenes"], draws: Int[Array, ""]
) -> Float[Array, "scenes agents 3"]:
    root = jax.random.key(seed)

    def one(number: Int[Array, ""]) -> Float[Array, "agents 3"]:
        key = jax.random.fold_in(jax.random.fold_in(root, number), draws)
        return jax.random.normal(key, (MAX_OBJECTS, 3))  # for every padded size the same numbers

    return jax.vmap(one)(numbers)


def initial_noise(
    seed: int, numbers: Int[np.ndarray, " scenes"], draw_number: int
) -> Float[np.ndarray, "scenes agents 3"]:
    """z(0) of scenes by their number in the run: N(0, I), the same whatever the batch or the guidance."""
    count = padded_batch(len(numbers))
    padded = np.resize(numbers, -(-len(numbers) // count) * count)
    return np.asarray(_noise(seed, padded, draw_number))[: len(numbers)]


@eqx.filter_jit
def _path_program(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array, "agents 3"],
    condition: TabletopCondition,
    grid: Float[Array, " points"],
    guard: StepGuard | None,
) -> Float[Array, "points agents 3"] | None:
    return generate(
        field, guidance, z0, condition, grid=grid, guard=guard, mask=condition.mask,
        keep_trace=False, keep_path=True,
    ).path  # fmt: skip


def _nobody(number: int, scene: Scene) -> None:
    """Watches no draw."""


class TabletopGenerator:
    """Generates scenes with one field and one guidance; compiled programs are kept between calls."""

    def __init__(
        self,
        field: Field,
        guidance: AbstractGuidance | None = None,
        *,
        steps: int = DEFAULT_STEPS,
        power: float = 2.0,
        guard: StepGuard | None = GUARD,
    ) -> None:
        """Args: field: nominal field; guidance: `NoGuidance()` if None; steps, power: of `refined_grid`; guard: of guided steps; None: fixed steps."""
        self.field, self.steps, self.power = field, steps, power
        self.grid = refined_grid(steps, power)
        self.guidance = NoGuidance() if guidance is None else guidance
        self.guard = None if guidance is None else guard
        self._together = partial(_program, field)
        # Of a few rows, laying out the weights is most of a product's work: as constants they are laid out once.
        self._alone = eqx.filter_jit(partial(_generated, field))
        self._compiled: set[tuple[int, bool, bool]] = set()

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
        records: list[GenerationRecord | None] = [None] * len(conditions)
        for part in _alike(conditions):
            guidance = self.guidance_for(conditions[part[0]])
            drawn = self.draw(noise[part, :agents], take(arrays, part), guidance, keep_trace)
            z[part] = drawn.z
            for k, number in enumerate(part):
                summary, trace = jax.tree.map(lambda leaf, k=k: leaf[k], drawn[1:])
                records[number] = _record(guidance, summary, trace, conditions[number].objects)
        poses = [decode_exactly(state, c) for state, c in zip(z, conditions, strict=True)]
        return Batch(z, poses, records)

    def draw(
        self,
        noise: Float[np.ndarray, "scenes agents 3"],
        arrays: TabletopCondition,
        guidance: AbstractGuidance | None = None,
        keep_trace: bool = False,
    ) -> _Drawn:
        """The compiled program alone, in float32, as numpy arrays, large batches in blocks; nothing decoded or judged."""
        guidance = self.guidance if guidance is None else guidance

        def one(index: Int[np.ndarray, " scenes"]) -> _Drawn:
            return self._block(noise[index], take(arrays, index), guidance, keep_trace)

        kind = noise.shape[1], keep_trace, guidance is self.guidance
        parts = map_blocks(one, blocks(len(noise)), compiled=kind in self._compiled)
        self._compiled.add(kind)
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)

    def _block(
        self,
        noise: Float[np.ndarray, "scenes agents 3"],
        arrays: TabletopCondition,
        guidance: AbstractGuidance,
        keep_trace: bool,
    ) -> _Drawn:
        """`draw` of a block, padded to one of the sizes that programs are compiled for."""
        count = len(noise)
        index = np.resize(np.arange(count), padded_batch(count))
        program = self._alone if count == 1 else self._together
        given = guidance, jnp.asarray(noise[index]), take(arrays, index)
        drawn = program(*given, self.grid, self.guard, keep_trace)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[:count], drawn)

    def path(self, z0: Float[np.ndarray, "agents 3"], condition: SceneCondition) -> list[Poses]:
        """Poses of one scene at every grid point, from a given z(0)."""
        arrays = to_arrays([condition])
        size, scene = arrays.mask.shape[1], take(arrays, 0)
        guidance = self.guidance_for(condition)
        z = _path_program(
            self.field, guidance, jnp.asarray(z0[:size]), scene, self.grid, self.guard
        )
        return [decode_exactly(state, condition) for state in np.asarray(z)]

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
            wanted = [conditions[k] for k in index]
            numbers = np.add(index, first)
            batch = self.batch(initial_noise(seed, numbers, number), wanted, keep_trace=keep_trace)
            found = judged(batch, wanted, seed)
            for one, candidate in zip(numbers, found, strict=True):
                on_draw(int(one), with_draws(candidate.sample, number + 1))
            return found

        return finished(redraw_until_satisfied(attempt, len(conditions), max_draws))


def _alike(conditions: Sequence[SceneCondition]) -> list[Int[np.ndarray, " part"]]:
    """Parts of a batch that one guidance takes: those with a shared requirement apart from those without."""
    balanced = np.array([condition.balance is not None for condition in conditions])
    return [group for group in (np.flatnonzero(~balanced), np.flatnonzero(balanced)) if len(group)]


def _record(
    guidance: AbstractGuidance, summary: Summary, trace: Trace | None, objects: Sequence[str]
) -> GenerationRecord | None:
    if not isinstance(guidance, DecoupledGuidance):
        return None
    return record(summary, guidance.names, objects, trace)


def judged(batch: Batch, conditions: Sequence[SceneCondition], seed: int) -> list[Candidate[Scene]]:
    """Every scene of a batch with its certificate."""
    settled, out = judge_generated(conditions, batch.poses), []
    for k, (verdict, diverged) in enumerate(zip(settled.verdicts, settled.diverged, strict=True)):
        made = batch.records[k]
        reason = verdict.reason(conditions[k].objects)
        if reason is not None and made is not None and made.first_failure is not None:
            reason += f"; on the way {made.first_failure}"
        if diverged:
            reason = REASON
        certificate = Certificate(
            verdict.satisfied and not diverged,
            verdict.min_margin,
            verdict.violation,
            1,
            reason,
            made,
        )
        scene = Scene(conditions[k], settled.poses[k], certificate, seed)
        out.append(Candidate(scene, certificate.satisfied, certificate.min_margin))
    return out
