"""How the violation evolves while a scene is generated, and the search for scenes that serve as examples."""

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

Fits = Callable[[SceneCondition, Poses], SceneCondition | None]
"""(a default condition, its nominal scene) -> the condition for guidance, or None if the case does not fit."""

_BATCH = 16  # cases of one search step
_LIMIT = 2_048  # cases searched in all


class Evolution(NamedTuple):
    """One generation under one condition.

    Attributes:
        tau: Times of the points.
        violation: V at each point, m^2.
        bound: The theorem's bound on V at each point; None without guidance.
        poses: The decoded scene at each point.
    """

    tau: list[float]
    violation: list[float]
    bound: list[float] | None
    poses: list[Poses]

    def to_json(self) -> dict[str, Any]:
        """JSON values for a result: the curves and the scene at the end."""
        out = {**self._asdict(), "poses": self.poses[-1].tolist()}
        return out if self.bound is not None else {k: v for k, v in out.items() if k != "bound"}


class Case(NamedTuple):
    """A randomly drawn condition and its z(0).

    Attributes:
        number: Number of the case in the run of its seed.
        condition: The condition.
        z0: Initial states.
    """

    number: int
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
    """V of the condition's requirements along a generation from z(0), guided or not."""
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
    """A case without and with guidance, from the same z(0).

    Attributes:
        case: The case.
        tried: Number of cases searched, including this one.
        passed_over: Of these, cases that fitted but that guidance did not satisfy.
        nominal: The generation without guidance.
        guided: The generation with guidance.
    """

    case: Case
    tried: int
    passed_over: int
    nominal: Evolution
    guided: Evolution

    def to_json(self) -> dict[str, Any]:
        """JSON values for a result."""
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
    fits: Fits,
    say: Progress,
) -> Pair:
    """The first case of a seed whose nominal scene fits and which guidance satisfies.

    Args:
        nominal: Generates without guidance.
        guided: Generates with guidance.
        size: Number of objects.
        seed: Seed of objects and z(0): case k is case k of `deggflow tabletop generate --seed`.
        fits: Maps a default condition and its nominal scene to the condition for guidance, or None if the case does not fit.
        say: Called with the progress of the search.

    Raises:
        RuntimeError: None of the first 2,048 cases fits.
    """
    passed_over = 0
    for case, target in _candidates(nominal, size, seed, fits, say):
        before = evolution(nominal, case.z0, target)
        # A single scene rounds differently than in a batch.
        if fits(case.condition, before.poses[-1]) is None:
            continue
        after = evolution(guided, case.z0, target)
        if judge([target], [after.poses[-1]])[0].satisfied:
            return Pair(case, case.number + 1, passed_over, before, after)
        passed_over += 1
    raise RuntimeError(f"none of the first {_LIMIT} cases of seed {seed} fits")


def _candidates(
    nominal: TabletopGenerator,
    size: int,
    seed: int,
    fits: Fits,
    say: Progress,
) -> Iterator[tuple[Case, SceneCondition]]:
    for first in range(0, _LIMIT, _BATCH):
        say(f"searching for an example, {first} cases done")
        conditions = random_conditions(size, _BATCH, "default", seed, first)
        noise = initial_noise(seed, np.arange(first, first + _BATCH), 0)
        scenes = nominal.batch(noise, conditions).poses
        for k, (condition, poses) in enumerate(zip(conditions, scenes, strict=True)):
            target = fits(condition, poses)
            if target is not None:
                yield Case(first + k, condition, noise[k]), target


def in_words(breach: Breach, condition: SceneCondition) -> str:
    """A breach in words, without its size."""
    text = Verdict(breach.margin, 0.0, (breach,)).reason(condition.objects)
    return re.sub(r" by [\d.]+ m$", "", str(text)).replace("_", " ")


def final(result: Mapping[str, Any], which: str) -> Poses:
    """The scene at the end of a stored evolution."""
    return np.array(result[which]["poses"], np.float64)
