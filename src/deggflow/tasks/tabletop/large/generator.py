"""Certified large scenes from the tabletop's nominal field, one large scene at a time."""

from collections.abc import Sequence
from functools import cache, partial
from itertools import groupby

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.drift import AbstractDrift, aligned
from deggflow.field import MessagePassingField
from deggflow.generation import DEFAULT_STEPS, Generation, refined_grid
from deggflow.guidance import (
    AbstractGuidance,
    DecoupledGuidance,
    Local,
    NoGuidance,
    PrivateRequirement,
)
from deggflow.recording import record
from deggflow.redraw import Candidate, finished, redraw_until_satisfied
from deggflow.sampler import masked_sample
from deggflow.shapes import Scalar
from deggflow.step_guard import StepGuard
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.generator import (
    MAX_DRAWS,
    Batch,
    TabletopGenerator,
    default_drift,
    judged,
)
from deggflow.tasks.tabletop.margins import LABELS
from deggflow.tasks.tabletop.requirements import balance_of, imbalance_of
from deggflow.tasks.tabletop.scene import Scene
from deggflow.tasks.tabletop.verdict import BUFFER, Poses

from .condition import (
    LargeSceneCondition,
    decode,
    decode_exactly,
    is_large,
    padded_count,
    to_arrays,
)
from .field import large_scene_field
from .margins import LargeSceneMargins

HEARD, BESIDE = 32, 12  # neighbours for which field and requirements have room
CROWDS = (1, 2, 4)  # times that room, tried in turn where it does not do
GUARD = StepGuard(halvings=16)
SHORTER = 1.3  # steps of a large scene to those of a table


@cache  # one object for each: compiled programs are found by what they were compiled for
def large_scene_guidance(slots: int = BESIDE, *, balanced: bool = False) -> DecoupledGuidance:
    """Guidance of a large scene: private requirements shared out among neighbours, and the balance if it is asked for."""
    affordance = PrivateRequirement(
        LargeSceneMargins(slots),
        BUFFER,
        allocation=Local(),
        per_owner_gain=True,
        name="affordance",
        margin_labels=LABELS,
    )
    return DecoupledGuidance((affordance, BALANCE) if balanced else (affordance,))


def imbalance(tau: Scalar, z: Float[Array, "agents 3"], condition: LargeSceneCondition) -> Scalar:
    """The q of the requirement on the centre of mass."""
    return imbalance_of(decode(z, condition), condition.mass, condition.balance)


BALANCE = balance_of(imbalance)


@partial(jax.jit, static_argnums=3)
def _noise(
    seed: Int[Array, ""], number: Int[Array, ""], drawn: Int[Array, ""], agents: int
) -> Float[Array, "agents 3"]:
    key = jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), number), drawn)
    # A key for each object: the same numbers for every padded size.
    keys = jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(agents))
    return jax.vmap(lambda own: jax.random.normal(own, (3,)))(keys)


def initial_noise(
    condition: SceneCondition, seed: int, number: int, drawn: int
) -> Float[Array, "agents 3"]:
    """z(0) of a draw, padded: N(0, I), the same for every object whatever the scene's size."""
    return _noise(seed, number, drawn, padded_count(len(condition.objects)))


class LargeSceneGenerator:
    """Generates large scenes with one field, guided or not; compiled programs are kept between calls."""

    def __init__(
        self,
        field: MessagePassingField,
        guided: bool = True,
        *,
        grid: Float[Array, " points"] | None = None,
        drift: AbstractDrift | None = None,
        guard: StepGuard | None = GUARD,
    ) -> None:
        """Args: field: the tabletop's nominal field; guided: else nominal; grid: 130 steps if None; drift: of `generate`, as of `TabletopGenerator` if None; guard: of guided steps."""
        self.field, self.guided = field, guided
        self.grid = refined_grid(_steps(DEFAULT_STEPS)) if grid is None else grid
        drift = default_drift(len(self.grid) - 1) if drift is None else drift
        self.drift = drift if guided else drift.nominal
        self.guard = guard if guided else None

    def scene(
        self,
        condition: SceneCondition,
        *,
        seed: int = 0,
        number: int = 0,
        max_draws: int = MAX_DRAWS,
        keep_trace: bool = False,
    ) -> Scene:
        """A large scene with its certificate; a draw that fails is made again from a new z(0).

        Args: as of `TabletopGenerator.scenes`, of one condition and its number in the run.
        """

        def attempt(_: Sequence[int], drawn: int) -> list[Candidate[Scene]]:
            batch = self.batch(condition, seed, number, drawn, keep_trace=keep_trace)
            return judged(batch, [condition], seed)

        return finished(redraw_until_satisfied(attempt, 1, max_draws))[0]

    def batch(
        self,
        condition: SceneCondition,
        seed: int,
        number: int,
        drawn: int,
        *,
        keep_trace: bool = False,
    ) -> Batch:
        """One draw of one large scene."""
        z0 = initial_noise(condition, seed, number, drawn)
        out = self._draw(condition, z0, keep_trace=keep_trace)
        guidance, made = self._guidance(condition), None
        if isinstance(guidance, DecoupledGuidance):
            made = record(out.summary, guidance.names, condition.objects, out.trace)
        state = np.asarray(out.z)
        return Batch(state[None], [decode_exactly(state, condition)], [made])

    @property
    def taus(self) -> Float[np.ndarray, " points"]:
        """Tau at the points of a path."""
        return np.asarray(aligned(self.grid, self.drift.macro_grid())[0])

    def path(self, condition: SceneCondition, seed: int, number: int, drawn: int) -> list[Poses]:
        """Poses of one draw at every grid point."""
        z0 = initial_noise(condition, seed, number, drawn)
        out = self._draw(condition, z0, keep_path=True)
        assert out.path is not None
        return [decode_exactly(state, condition) for state in np.asarray(out.path)]

    def _draw(
        self,
        condition: SceneCondition,
        z0: Float[Array, "agents 3"],
        *,
        keep_trace: bool = False,
        keep_path: bool = False,
    ) -> Generation:
        """One draw with room for as many neighbours as there are."""
        arrays = to_arrays(condition, BUFFER)
        for crowd in CROWDS:
            guidance = self._guidance(condition, crowd)
            field = large_scene_field(self.field, HEARD * crowd)
            out = masked_sample(
                field,
                guidance,
                z0,
                arrays,
                self.grid,
                self.drift,
                self.guard,
                keep_trace,
                keep_path,
            )
            if bool(jnp.isfinite(out.z).all()):
                break
        return out

    def _guidance(self, condition: SceneCondition, crowd: int = 1) -> AbstractGuidance:
        if not self.guided:
            return NoGuidance()
        return large_scene_guidance(BESIDE * crowd, balanced=condition.balance is not None)


def _steps(of_table: int) -> int:
    return round(SHORTER * of_table)


def large_scenes_like(generator: TabletopGenerator) -> LargeSceneGenerator:
    """A generator of large scenes like one of scenes: its field, 1.3 times the steps that it was given, guided and guarded if it is."""
    if not isinstance(generator.field, MessagePassingField):
        raise TypeError(
            "large scenes need a `MessagePassingField`: other fields have no cut-off radius."
        )
    guided = isinstance(generator.guidance, DecoupledGuidance)
    guard = None if generator.guard is None else GUARD
    steps = DEFAULT_STEPS if generator.steps is None else generator.steps
    grid = refined_grid(_steps(steps), generator.power)
    return LargeSceneGenerator(
        generator.field, guided, grid=grid, drift=generator.drift, guard=guard
    )


def make_scenes(
    generator: TabletopGenerator,
    conditions: Sequence[SceneCondition],
    *,
    seed: int = 0,
    first: int = 0,
    max_draws: int = MAX_DRAWS,
    keep_trace: bool = False,
) -> list[Scene]:
    """Scenes and large scenes alike, in the order of the conditions; a scene does not depend on the large scenes beside it.

    Args: as of `TabletopGenerator.scenes`; large scenes are made by `large_scenes_like(generator)`.
    """
    out: list[Scene] = []
    for large, part in groupby(conditions, is_large):
        alike, number = list(part), first + len(out)
        if large:
            large_scenes = large_scenes_like(generator)
            out += [
                large_scenes.scene(
                    each, seed=seed, number=number + k, max_draws=max_draws, keep_trace=keep_trace
                )
                for k, each in enumerate(alike)
            ]
        else:
            out += generator.scenes(
                alike, seed=seed, first=number, max_draws=max_draws, keep_trace=keep_trace
            )
    return out
