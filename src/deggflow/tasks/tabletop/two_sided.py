"""Where guidance methods stand between a lower bound on the deviation of any method and their own upper bounds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.baselines import FadingField
from deggflow.blocks import padded_batch
from deggflow.deviation import drift_along, step_bound
from deggflow.drift import EVERY_STEP
from deggflow.flow import Field
from deggflow.generation import DEFAULT_STEPS, refined_grid
from deggflow.guidance import NoGuidance
from deggflow.statistics import Rate, Row

from .baselines import BaselineRun, Method
from .codec import decode_exactly
from .condition import TabletopCondition, padded_size, take, to_arrays
from .frontier import CHUNK, Cases, draw_cases, draw_samples
from .generator import initial_noise
from .least import least_deviation
from .projection import Scenes, project
from .settled import judge_generated

HUGE = 1e12  # squared bounds beyond it are not listed: the sample diverged
LOWER, NEAREST = "lower bound of any method", "nearest scenes found"


@dataclass(frozen=True)
class CaseDeviations(Row):
    """The deviations of one method at one size, case by case; in z, per object.

    Attributes:
        method: Its name, `LOWER` or `NEAREST`.
        size: Objects of each scene.
        satisfied: Whether exact geometry accepts each sample; of `LOWER`, the nominal sample.
        squared: Squared distance to the nominal sample of the same z(0), sum over objects divided by their number; None
            where the sample diverged.
        upper: Squared bound by the steps of the sample's path; None without a path.
    """

    method: str
    size: int
    satisfied: list[bool]
    squared: list[float | None]
    upper: list[float | None]

    def rate(self) -> Rate:
        """Success."""
        return Rate(sum(self.satisfied), len(self.satisfied))


class _Guided(NamedTuple):
    """Samples of a method with the bounds of their own steps.

    Attributes:
        z: The samples.
        upper: Bound on each sample's distance to its nominal one, in z; None without a path.
    """

    z: Scenes
    upper: Float[np.ndarray, " cases"] | None


class _Nominal(NamedTuple):
    """Nominal paths.

    Attributes:
        path: States at the grid points.
        drift: The field there, the last point excluded.
    """

    path: Float[np.ndarray, "scenes points agents 3"]
    drift: Float[np.ndarray, "scenes steps agents 3"]


Noise = Float[Array, "scenes agents 3"]
_Paths = Float[Array, "scenes points agents 3"]
_Index = Int[np.ndarray, " scenes"]


def jobs(
    field: Field,
    grid: Sequence[tuple[int, Method | str]],
    cases: int,
    seed: int,
    nearby: Method,
    say: Callable[[str], None] = lambda text: None,
) -> list[Callable[[], CaseDeviations]]:
    """One measurement for each size and method, `LOWER` or `NEAREST`.

    Args:
        field: Nominal vector field.
        grid: Sizes and methods, which run at their selected settings.
        cases: Random cases of each size.
        seed: Of cases and z(0).
        nearby: Method whose samples are the second start of the search for near scenes.
        say: Told of each measurement as it begins.
    """

    @cache
    def of_size(size: int) -> Cases:
        return draw_cases(field, size, "changed", cases, seed)

    @cache
    def nominal(size: int) -> _Nominal:
        return _nominal(field, of_size(size))

    known: dict[tuple[int, str], _Guided] = {}

    def guided(size: int, method: Method) -> _Guided:
        if (size, method.name) not in known:
            known[size, method.name] = _guided(field, method, of_size(size), nominal(size))
        return known[size, method.name]

    def job(size: int, method: Method | str) -> Callable[[], CaseDeviations]:
        def run() -> CaseDeviations:
            name = method if isinstance(method, str) else method.name
            say(f"N = {size}, {name}, {cases} cases")
            if method == LOWER:
                return _lower(of_size(size))
            if method == NEAREST:
                return _nearest(of_size(size), guided(size, nearby).z)
            assert isinstance(method, Method)
            return _row(name, of_size(size), guided(size, method))

        return run

    return [job(*each) for each in grid]


def _lower(cases: Cases) -> CaseDeviations:
    squared = [
        least_deviation(condition, z) / cases.size
        for condition, z in zip(cases.conditions, cases.nominal, strict=True)
    ]
    accepted = _row(LOWER, cases, _Guided(cases.nominal, None)).satisfied
    return CaseDeviations(LOWER, cases.size, accepted, list(squared), [None] * len(squared))


def _nearest(cases: Cases, start: Scenes) -> CaseDeviations:
    """The nearer of two scenes, from the nominal one and from a method's sample."""
    target = cases.nominal.astype(np.float64)
    projections = np.stack([project(cases.conditions, target, each) for each in (target, start)])
    square = np.sum((projections - target) ** 2, axis=(2, 3))
    first = np.nan_to_num(square[0], nan=np.inf) <= np.nan_to_num(square[1], nan=np.inf)
    return _row(NEAREST, cases, _Guided(np.where(first[:, None, None], *projections), None))


def _row(name: str, cases: Cases, guided: _Guided) -> CaseDeviations:
    poses = [decode_exactly(z, c) for z, c in zip(guided.z, cases.conditions, strict=True)]
    settled = judge_generated(cases.conditions, poses)
    gap = guided.z.astype(np.float64) - cases.nominal
    squared = np.sum(gap**2, axis=(1, 2)) / cases.size
    upper = np.full(len(squared), np.nan) if guided.upper is None else guided.upper**2 / cases.size
    return CaseDeviations(
        name,
        cases.size,
        [verdict.satisfied for verdict in settled.verdicts],
        [None if gone else float(d) for d, gone in zip(squared, settled.diverged, strict=True)],
        [float(u) if np.isfinite(u) and u < HUGE else None for u in upper],
    )


def _nominal(field: Field, cases: Cases) -> _Nominal:
    """Nominal paths, on the grid of methods that guide throughout."""

    def chunk(noise: Noise, condition: TabletopCondition, _: _Index) -> _Nominal:
        path = _path(field, BaselineRun(NoGuidance()), noise, condition)
        drift = _drifts(field, refined_grid(), path, condition)
        return _Nominal(np.asarray(path), np.asarray(drift))

    return _Nominal(*_in_chunks(chunk, cases))


def _guided(field: Field, method: Method, cases: Cases, nominal: _Nominal) -> _Guided:
    """Samples at the selected setting; of methods that draw once, with the bounds of their steps.

    Of a prediction followed by a correction, the recursion begins with the prediction's own distance to the nominal
    sample, which takes twice as many steps, and the nominal path stays at its end.
    """
    way, size = method.make(method.chosen(cases.size)), cases.size
    if way.draws > 1:
        return _Guided(draw_samples(field, way, cases).z, None)

    def chunk(noise: Noise, condition: TabletopCondition, index: _Index) -> _Guided:
        path = _path(field, way, noise, condition)
        guided, reference = np.asarray(path), np.asarray(nominal.path[index])
        if way.pull is None:
            grid = refined_grid()
            difference = np.asarray(_drifts(field, grid, path, condition)) - nominal.drift[index]
        else:
            grid = refined_grid(DEFAULT_STEPS // 2)
            fading = FadingField(field, way.pull)
            difference = np.asarray(_drifts(fading, grid, path, condition))
            reference = np.broadcast_to(reference[:, -1:], guided.shape)
        upper = step_bound(
            np.asarray(grid), reference[:, :, :size], guided[:, :, :size], difference[:, :, :size]
        )
        return _Guided(guided[:, -1, :size], upper)

    return _Guided(*_in_chunks(chunk, cases))


def _in_chunks(
    call: Callable[[Noise, TabletopCondition, _Index], tuple[Any, ...]], cases: Cases
) -> list[np.ndarray]:
    """The arrays that `call` returns, for all cases."""
    count, agents = len(cases.conditions), padded_size(cases.size)
    noise = initial_noise(cases.seed, np.arange(count), 0)[:, :agents]
    arrays, parts = to_arrays(cases.conditions, agents), []
    for begin in range(0, count, CHUNK):
        some = min(CHUNK, count - begin)
        index = begin + np.resize(np.arange(some), padded_batch(some))
        outputs = call(jnp.asarray(noise[index]), take(arrays, index), index)
        parts.append([np.asarray(each)[:some] for each in outputs])
    return [np.concatenate(each) for each in zip(*parts, strict=True)]


@eqx.filter_jit
def _path(field: Field, way: BaselineRun, noise: Noise, condition: TabletopCondition) -> _Paths:
    path = way.generate(field, noise, condition, keep_path=True).path
    assert path is not None
    return path


@eqx.filter_jit
def _drifts(
    field: Field, grid: Float[Array, " points"], path: _Paths, condition: TabletopCondition
) -> Float[Array, "scenes steps agents 3"]:
    return jax.vmap(lambda z, chi: drift_along(field, EVERY_STEP, grid, z, chi))(path, condition)
