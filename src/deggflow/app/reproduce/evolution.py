"""How a violation evolves while one scene is generated, and which scenes are worth showing."""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.codec import decode_exactly
from deggflow.tasks.tabletop.condition import SceneCondition, TabletopCondition, take, to_arrays
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.margins import TABLETOP
from deggflow.tasks.tabletop.verdict import BUFFER, Breach, Poses, Verdict, judge

from .experiment import Progress

_BATCH = 16  # cases looked at together
_LIMIT = 2_048  # cases looked at in all


class Evolution(NamedTuple):
    """One generation under one condition."""

    tau: list[float]
    violation: list[float]  # V at every tau, m^2
    bound: list[float] | None  # what the theorem promises of V; None if nobody guides
    poses: list[Poses]  # at every tau

    def to_json(self) -> dict[str, Any]:
        """As it stands in a result: the curves and the scene at the end."""
        out = {**self._asdict(), "poses": self.poses[-1].tolist()}
        return out if self.bound is not None else {k: v for k, v in out.items() if k != "bound"}


class Case(NamedTuple):
    """A drawn case: a condition and its z(0)."""

    number: int  # in the run of its seed
    condition: SceneCondition
    z0: Float[np.ndarray, "agents 3"]


@eqx.filter_jit
def _violations(
    path: Float[Array, "points agents 3"], condition: TabletopCondition
) -> Float[Array, " points"]:
    return jax.vmap(lambda z: jnp.sum(TABLETOP.violation(z, condition, BUFFER)))(path)


def evolution(
    generator: TabletopGenerator, z0: Float[np.ndarray, "agents 3"], condition: SceneCondition
) -> Evolution:
    """V of the condition's requirements along a generation from z(0), whoever guides it, or nobody."""
    scene = take(to_arrays([condition]), 0)
    generation = generator.generation(z0, condition, keep_trace=True)
    assert generation.path is not None
    assert generation.trace is not None
    bound = np.asarray(generation.trace.bound)
    return Evolution(
        generator.grid.tolist(),
        _violations(generation.path, scene).tolist(),
        bound[:, 0].tolist() if bound.shape[1] else None,
        [decode_exactly(z, condition) for z in np.asarray(generation.path)],
    )


class Pair(NamedTuple):
    """A case as nobody guides it and as it is guided, from the same z(0)."""

    case: Case
    tried: int  # cases looked at, this one included
    passed_over: int  # of these, cases that would have served, had guidance satisfied them
    nominal: Evolution
    guided: Evolution

    def to_json(self) -> dict[str, Any]:
        """As it stands in a result."""
        return {
            "number": self.case.number,
            "tried": self.tried,
            "passed_over": self.passed_over,
            "nominal": self.nominal.to_json(),
            "guided": self.guided.to_json(),
        }


def first_pair(
    nominal: TabletopGenerator,
    guided: TabletopGenerator,
    size: int,
    seed: int,
    fits: Callable[[SceneCondition, Poses], SceneCondition | None],
    say: Progress,
) -> Pair:
    """The first case of a seed whose nominal scene shows what is wanted, and that guidance satisfies.

    Args:
        nominal: Generates without guidance.
        guided: Generates with guidance.
        size: Number of objects.
        seed: Of objects and z(0), as everywhere: case k is case k of `deggflow tabletop generate --seed`.
        fits: Told a default condition and its nominal scene; returns the condition to guide, or None.
        say: Told how many cases were looked at.

    Raises:
        RuntimeError: None of the first 2,048 cases serves.
    """
    passed_over = 0
    for case, wanted in _wanted(nominal, size, seed, fits, say):
        before = evolution(nominal, case.z0, wanted)
        # One by one scenes round differently than in a batch.
        if fits(case.condition, before.poses[-1]) is None:
            continue
        after = evolution(guided, case.z0, wanted)
        if judge([wanted], [after.poses[-1]])[0].satisfied:
            return Pair(case, case.number + 1, passed_over, before, after)
        passed_over += 1
    raise RuntimeError(f"none of the first {_LIMIT} cases of seed {seed} shows what is wanted")


def _wanted(
    nominal: TabletopGenerator,
    size: int,
    seed: int,
    fits: Callable[[SceneCondition, Poses], SceneCondition | None],
    say: Progress,
) -> Iterator[tuple[Case, SceneCondition]]:
    for first in range(0, _LIMIT, _BATCH):
        say(f"looking for an example, {first} cases seen")
        conditions = random_conditions(size, _BATCH, "default", seed, first)
        noise = initial_noise(seed, np.arange(first, first + _BATCH), 0)
        scenes = nominal.batch(noise, conditions).poses
        for k, (condition, poses) in enumerate(zip(conditions, scenes, strict=True)):
            wanted = fits(condition, poses)
            if wanted is not None:
                yield Case(first + k, condition, noise[k]), wanted


def in_words(breach: Breach, condition: SceneCondition) -> str:
    """One breach as a reader says it, without how far."""
    text = Verdict(breach.margin, 0.0, (breach,)).reason(condition.objects)
    return re.sub(r" by [\d.]+ m$", "", str(text)).replace("_", " ")


def final(result: Mapping[str, Any], which: str) -> Poses:
    """The scene at the end of a stored evolution."""
    return np.array(result[which]["poses"], np.float64)
