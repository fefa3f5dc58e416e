"""Certified scenes from a nominal field: batches, verdicts and redraws."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.certificate import Certificate
from deggflow.flow import Field
from deggflow.generation import DEFAULT_STEPS, generate, refined_grid
from deggflow.guidance import (
    AbstractAllocation,
    AbstractGuidance,
    DecoupledGuidance,
    Local,
    NoGuidance,
    Own,
    Pooled,
    PrivateRequirement,
)
from deggflow.redraw import BATCHES, Candidate, draw, padded_batch
from deggflow.step_guard import StepGuard

from .codec import decode_exactly
from .condition import SceneCondition, TabletopCondition, padded_size, take, to_arrays
from .library import MAX_OBJECTS
from .margins import HingeViolation, dependence
from .scene import Scene
from .verdict import BUFFER, Poses, judge

MAX_DRAWS = 8
MAX_COORDINATE = 1e4  # m and rad; what lies beyond has diverged, and scene files do not hold it


OWN, POOLED = Own(), Pooled()
LOCAL = Local(partial(dependence, buffer=BUFFER))


def tabletop_guidance(
    allocation: AbstractAllocation = POOLED, *, reanchored: bool = True
) -> DecoupledGuidance:
    """Guidance for the tabletop's private requirements, with the paper's constants.

    Args:
        allocation: `OWN` (the paper's), `POOLED` or `LOCAL`.
        reanchored: Take c afresh from the present violation instead of V(0).
    """
    requirement = PrivateRequirement(
        violation=HingeViolation(BUFFER),
        allocation=allocation,
        reanchored=reanchored,
        floor=BUFFER**2 / 2,
        name="affordance",
    )
    return DecoupledGuidance((requirement,))


class Batch(NamedTuple):
    """One draw of some scenes."""

    z: Float[np.ndarray, "scenes agents 3"]
    poses: list[Float[np.ndarray, "objects 3"]]  # x, y in m, theta in rad
    infeasible: Int[
        np.ndarray, "scenes agents"
    ]  # steps at which an object had no input to meet its row


@eqx.filter_jit
def _program(
    field: Field,
    guidance: AbstractGuidance,
    noise: Float[Array, "scenes agents 3"],
    condition: TabletopCondition,
    grid: Float[Array, " points"],
    guard: StepGuard | None,
) -> tuple[Float[Array, "scenes agents 3"], Int[Array, "scenes agents"]]:
    def one(
        z0: Float[Array, "agents 3"], scene: TabletopCondition
    ) -> tuple[Float[Array, "agents 3"], Int[Array, " agents"]]:
        out = generate(field, guidance, z0, scene, grid=grid, guard=guard)
        stuck = jnp.sum(out.trace.infeasible & scene.mask[None], axis=0)
        return out.z, stuck

    return jax.vmap(one)(noise, condition)


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
    return generate(field, guidance, z0, condition, grid=grid, guard=guard, keep_path=True).path


class TabletopGenerator:
    """Generates scenes with one field and one guidance; compiled programs are kept between calls."""

    def __init__(
        self,
        field: Field,
        guidance: AbstractGuidance | None = None,
        *,
        steps: int = DEFAULT_STEPS,
        power: float = 2.0,
        guard: StepGuard | None = None,
    ) -> None:
        """Args: field: nominal field; guidance: `NoGuidance()` if None; steps, power: of `refined_grid`; guard: of guided steps; fixed steps if None."""
        self.field, self.grid = field, refined_grid(steps, power)
        self.guidance = NoGuidance() if guidance is None else guidance
        self.guard = None if guidance is None else guard

    def batch(
        self, noise: Float[np.ndarray, "scenes agents 3"], conditions: Sequence[SceneCondition]
    ) -> Batch:
        """One draw of each condition from given z(0)."""
        agents = padded_size(max(len(c.objects) for c in conditions))
        arrays = to_arrays(conditions, agents)
        parts = [slice(k, k + BATCHES[-1]) for k in range(0, len(conditions), BATCHES[-1])]
        drawn = [self._padded(noise[part, :agents], take(arrays, part)) for part in parts]
        z = np.concatenate([state for state, _ in drawn])
        poses = [decode_exactly(state, c) for state, c in zip(z, conditions, strict=True)]
        return Batch(z, poses, np.concatenate([stuck for _, stuck in drawn]))

    def _padded(
        self, noise: Float[np.ndarray, "scenes agents 3"], arrays: TabletopCondition
    ) -> tuple[Float[np.ndarray, "scenes agents 3"], Int[np.ndarray, "scenes agents"]]:
        count = len(noise)
        index = np.resize(np.arange(count), padded_batch(count))
        z, stuck = _program(
            self.field,
            self.guidance,
            jnp.asarray(noise[index]),
            take(arrays, index),
            self.grid,
            self.guard,
        )
        return np.asarray(z)[:count], np.asarray(stuck)[:count]

    def path(self, z0: Float[np.ndarray, "agents 3"], condition: SceneCondition) -> list[Poses]:
        """Poses of one scene at every grid point, from a given z(0)."""
        arrays = to_arrays([condition])
        size, scene = arrays.mask.shape[1], take(arrays, 0)
        z = _path_program(
            self.field, self.guidance, jnp.asarray(z0[:size]), scene, self.grid, self.guard
        )
        return [decode_exactly(state, condition) for state in np.asarray(z)]

    def scenes(
        self,
        conditions: Sequence[SceneCondition],
        *,
        seed: int = 0,
        first: int = 0,
        max_draws: int = MAX_DRAWS,
    ) -> list[Scene]:
        """Scenes with certificates; a draw that fails is made again from a new z(0).

        Args:
            conditions: What to generate.
            seed: With a scene's number and the number of the draw, decides z(0).
            first: Number of the first condition in the run.
            max_draws: Limit per scene; where none is satisfied the closest is returned.
        """

        def attempt(index: Sequence[int], number: int) -> list[Candidate[Poses]]:
            wanted = [conditions[k] for k in index]
            batch = self.batch(initial_noise(seed, np.add(index, first), number), wanted)
            return _judged(batch, wanted)

        drawn = draw(attempt, len(conditions), max_draws)
        return [
            Scene(condition, candidate.sample, candidate.certificate, seed)
            for condition, candidate in zip(conditions, drawn, strict=True)
        ]


def _judged(batch: Batch, conditions: Sequence[SceneCondition]) -> list[Candidate[Poses]]:
    finite = [bool((np.abs(poses) <= MAX_COORDINATE).all()) for poses in batch.poses]
    # A diverged draw has no place on the table; it is judged where nothing fits: beyond the table's corner.
    poses = [
        p if ok else np.full_like(p, [c.width, c.depth, 0.0])
        for p, c, ok in zip(batch.poses, conditions, finite, strict=True)
    ]
    out = []
    for k, verdict in enumerate(judge(conditions, poses)):
        reason = verdict.reason(conditions[k].objects)
        if reason is not None:
            reason += _stuck(batch.infeasible[k], conditions[k].objects)
        if not finite[k]:
            reason = "the generation diverged to numbers that are not finite"
        certificate = Certificate(
            verdict.satisfied and finite[k], verdict.min_margin, verdict.violation, 1, reason
        )
        out.append(Candidate(poses[k], certificate))
    return out


def _stuck(infeasible: Int[np.ndarray, " agents"], objects: Sequence[str]) -> str:
    """Who could not meet its row, for the reason of a failed draw."""
    steps, agent = infeasible.max(), int(infeasible.argmax())
    if not steps:
        return ""
    return f"; at {steps} steps no input of {objects[agent]} met its row (ell ~ 0, b > 0)"
