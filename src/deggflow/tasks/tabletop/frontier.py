"""Success and deviation of every method on the same field, z(0) and requirements."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.blocks import padded_batch
from deggflow.deviation import squared_distances, wasserstein
from deggflow.flow import Field
from deggflow.guidance import NoGuidance
from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.statistics import Rate, Row

from .baselines import BaselineRun, Hyperparameters, Method
from .changes import random_conditions
from .codec import decode_exactly
from .condition import SceneCondition, TabletopCondition, padded_size, take, to_arrays
from .generator import initial_noise
from .settled import judge_generated
from .verdict import Verdict

CHUNK = 128  # scenes generated at once


@dataclass(frozen=True)
class Point(Row):
    """One method, one setting, one size: first draws (all draws for rejection sampling)."""

    method: str
    hyperparameters: dict[str, float]
    size: int
    cases: int
    satisfied: int
    diverged: int  # not finite, or far off the table
    worst: float  # m, the largest violation of a margin, 0 if there is none, without diverged cases
    # Over the cases that did not diverge; None if all did:
    deviation: float | None  # RMS distance to the nominal sample of the same z(0), in z, per object
    transport: float | None  # W2 to the nominal samples by optimal assignment, in z, per object
    seconds: float  # per scene, in batches of `CHUNK`, compiled
    draws: float  # mean number of samples drawn

    def rate(self) -> Rate:
        """Success."""
        return Rate(self.satisfied, self.cases)


class Cases(NamedTuple):
    """The cases, which are the same for every method."""

    conditions: Sequence[SceneCondition]
    seed: int
    nominal: Float[np.ndarray, "cases objects 3"]  # in z

    @property
    def size(self) -> int:
        """Objects of each scene."""
        return len(self.conditions[0].objects)


class _Sample(NamedTuple):
    z: Float[np.ndarray, "objects 3"]
    verdict: Verdict
    finite: bool


class Samples(NamedTuple):
    """One sample of every case by one method.

    Attributes:
        z: The samples.
        verdicts: Verdicts of exact geometry.
        finite: Whether each is finite and near the table.
        seconds: Time of all samples together.
        draws: Number of samples drawn in all.
    """

    z: Float[np.ndarray, "cases objects 3"]
    verdicts: list[Verdict]
    finite: list[bool]
    seconds: float
    draws: int


@eqx.filter_jit
def _program(
    field: Field,
    way: BaselineRun,
    noise: Float[Array, "scenes agents 3"],
    condition: TabletopCondition,
) -> Float[Array, "scenes agents 3"]:
    return way.generate(field, noise, condition).z


def draw_cases(field: Field, size: int, requirements: str, cases: int, seed: int) -> Cases:
    """Random conditions with the nominal sample of each."""
    conditions = random_conditions(size, cases, requirements, seed)
    empty = Cases(conditions, seed, np.zeros((cases, size, 3), np.float32))
    nominal = _generate(field, BaselineRun(NoGuidance()), empty, np.arange(cases), 0)
    return empty._replace(nominal=nominal.z)


def measure(field: Field, method: Method, hyperparameters: Hyperparameters, cases: Cases) -> Point:
    """Runs one method on all cases; programs are compiled before the time is measured."""
    way, count = method.make(hyperparameters), len(cases.conditions)
    _generate(field, way, cases, np.arange(min(CHUNK, count)), 0)
    samples = draw_samples(field, way, cases)
    settled = np.array(samples.finite)
    margins = [v.min_margin for v, ok in zip(samples.verdicts, samples.finite, strict=True) if ok]
    return Point(
        method.name,
        dict(hyperparameters),
        cases.size,
        count,
        satisfied=sum(v.satisfied for v in samples.verdicts),
        diverged=count - int(settled.sum()),
        worst=max(0.0, -min(margins, default=0.0)),
        deviation=_paired(samples.z[settled], cases.nominal[settled]),
        transport=_transport(samples.z[settled], cases.nominal[settled]),
        seconds=samples.seconds / count,
        draws=samples.draws / count,
    )


def jobs(
    field: Field,
    grid: Sequence[tuple[int, Method, Hyperparameters]],
    cases: int,
    seed: int,
    say: Callable[[str], None] = lambda text: None,
) -> list[Callable[[], Point]]:
    """One measurement for each size, method and setting; the cases of a size are drawn once, at first use.

    `say` is called at the start of each measurement.
    """

    @cache
    def of_size(size: int) -> Cases:
        return draw_cases(field, size, "changed", cases, seed)

    def job(size: int, method: Method, hyperparameters: Hyperparameters) -> Callable[[], Point]:
        def run() -> Point:
            say(f"N = {size}, {method.name}, {in_words(hyperparameters)}, {cases} cases")
            return measure(field, method, hyperparameters, of_size(size))

        return run

    return [job(*setting) for setting in grid]


def in_words(hyperparameters: Hyperparameters) -> str:
    """A setting in words."""
    return ", ".join(f"{name} {value:g}" for name, value in hyperparameters.items())


def draw_samples(field: Field, way: BaselineRun, cases: Cases) -> Samples:
    """One draw of every case, and further draws of failed cases if the method allows them."""
    seconds, draws = 0.0, 0

    def attempt(pending: Sequence[int], number: int) -> list[Candidate[_Sample]]:
        nonlocal seconds, draws
        samples = _generate(field, way, cases, np.asarray(pending), number)
        seconds, draws = seconds + samples.seconds, draws + samples.draws
        each = map(_Sample, samples.z, samples.verdicts, samples.finite)
        # Of refused draws the last one is kept, as in rejection sampling.
        return [Candidate(one, one.verdict.satisfied, float(number)) for one in each]

    results = redraw_until_satisfied(attempt, len(cases.conditions), way.draws)
    z, verdicts, finite = zip(*(each.sample for each in results), strict=True)
    return Samples(np.stack(z), list(verdicts), list(finite), seconds, draws)


def _generate(
    field: Field, way: BaselineRun, cases: Cases, numbers: np.ndarray, draw_number: int
) -> Samples:
    conditions = [cases.conditions[k] for k in numbers]
    agents = padded_size(cases.size)
    noise = initial_noise(cases.seed, numbers, draw_number)[:, :agents]
    arrays = to_arrays(conditions, agents)
    parts, seconds = [], 0.0
    for start in range(0, len(numbers), CHUNK):
        count = min(CHUNK, len(numbers) - start)
        padded = padded_batch(count)
        index = start + np.resize(np.arange(count), padded)
        inputs = jnp.asarray(noise[index]), take(arrays, index)
        start_time = time.perf_counter()
        states = np.asarray(_program(field, way, *inputs))
        seconds += (time.perf_counter() - start_time) * count / padded
        parts.append(states[:count])
    z = np.concatenate(parts)
    poses = [decode_exactly(state, c) for state, c in zip(z, conditions, strict=True)]
    settled = judge_generated(conditions, poses)
    finite = [not diverged for diverged in settled.diverged]
    return Samples(z[:, : cases.size], settled.verdicts, finite, seconds, len(numbers))


def _paired(
    z: Float[np.ndarray, "cases objects 3"], nominal: Float[np.ndarray, "cases objects 3"]
) -> float | None:
    return float(np.sqrt(np.mean(np.sum((z - nominal) ** 2, axis=-1)))) if len(z) else None


def _transport(
    z: Float[np.ndarray, "cases objects 3"], nominal: Float[np.ndarray, "cases objects 3"]
) -> float | None:
    return wasserstein(squared_distances(z, nominal) / z.shape[1]) if len(z) else None


def best(points: Sequence[Point]) -> Point:
    """The setting that represents a method: the most successes, then the least W2."""
    return min(points, key=lambda point: (-point.satisfied, _or_infinite(point.transport)))


def _or_infinite(value: float | None) -> float:
    return float("inf") if value is None else value
