"""How far guidance moves scenes from the nominal ones, and the theorem's bound on it (paper: app:task2_results)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.integrate import trapezoid

from deggflow.deviation import (
    Bounds,
    Deviation,
    bounds,
    couple,
    decoder_lipschitz,
    growth,
    measure,
    squared_distances,
    wasserstein,
)
from deggflow.statistics import Row

from .changes import random_conditions
from .codec import decode, decode_exactly
from .condition import SceneCondition, take, to_arrays
from .generator import TabletopGenerator, initial_noise

TURN_LENGTH = 0.1  # m per rad, lambda_theta (paper)
PATHS = 50  # samples for the theorem

States = Float[np.ndarray, "scenes objects 3"]  # z, or poses x, y in m and theta in rad


@dataclass(frozen=True)
class SceneDeviation:
    """Guided scenes compared with nominal ones of the same z(0); distances are RMS per object."""

    states: Deviation  # in z
    poses: Deviation  # m, in SE(2)


@dataclass(frozen=True)
class TheoremDeviation:
    """Both sides of thm:wasserstein for one condition; distances are of joint states, by fixed steps."""

    samples: int
    w2: float
    paired: float  # RMS of |Delta(1)|
    log_bounds: Bounds
    integral: float  # int L, trapezoidal
    largest: float  # L(tau)
    decoder: float  # L_D in m, m, rad
    poses_w2: float  # m, m, rad; at most `decoder` times `w2`


@dataclass(frozen=True)
class TabletopDeviation(Row):
    """One size: the paper's figures, those of one condition, and the theorem's."""

    size: int
    requirements: str
    cases: int
    scenes: SceneDeviation  # each scene has a condition of its own (as in the paper)
    condition: dict[str, Any]  # of the following figures
    same: SceneDeviation  # every scene has this condition (as in the theorem)
    theorem: TheoremDeviation


def scene_distances(
    first: States, second: Float[np.ndarray, "others objects 3"]
) -> Float[np.ndarray, "scenes others"]:
    """Squared distances between scenes, m^2: mean over objects, by index, of the squared distance in SE(2)."""
    total = np.zeros((len(first), len(second)))
    for one, other in zip(first.swapaxes(0, 1), second.swapaxes(0, 1), strict=True):
        x, y, theta = (one[:, None] - other[None]).transpose(2, 0, 1)
        turn = np.remainder(theta + np.pi, 2 * np.pi) - np.pi
        total += x**2 + y**2 + (TURN_LENGTH * turn) ** 2
    return total / first.shape[1]


def deviation(
    nominal: TabletopGenerator,
    guided: TabletopGenerator,
    size: int,
    requirements: str,
    cases: int,
    seed: int,
    *,
    paths: int = PATHS,
) -> TabletopDeviation:
    """All figures of one size.

    Args:
        nominal: Without guidance.
        guided: With guidance, of the same field and the same steps.
        size: Objects per scene.
        requirements: Family of `random_conditions`.
        cases: Scenes of each kind.
        seed: Of conditions and z(0).
        paths: Samples of the theorem's figures, which take longer.
    """
    conditions = random_conditions(size, cases, requirements, seed)
    one = conditions[0]
    return TabletopDeviation(
        size,
        requirements,
        cases,
        scenes=deviation_of_scenes(nominal, guided, conditions, seed),
        condition=one.to_json(),
        same=deviation_of_scenes(nominal, guided, [one] * cases, seed),
        theorem=deviation_of_theorem(guided, one, paths, seed),
    )


def deviation_of_scenes(
    nominal: TabletopGenerator,
    guided: TabletopGenerator,
    conditions: Sequence[SceneCondition],
    seed: int,
) -> SceneDeviation:
    """First draws compared with nominal scenes, for conditions of the same number of objects."""
    if not np.array_equal(nominal.grid, guided.grid):
        raise ValueError("`guided` must have the steps of `nominal`, else steps are compared, too.")
    size = len(conditions[0].objects)
    noise = initial_noise(seed, np.arange(len(conditions)), 0)
    batches = [each.batch(noise, conditions) for each in (nominal, guided)]
    states = [each.z[:, :size] for each in batches]
    poses = [np.stack(each.poses) for each in batches]
    return SceneDeviation(
        measure(*(squared_distances(a, b) / size for a, b in _pairs(*states))),
        measure(*(scene_distances(a, b) for a, b in _pairs(*poses))),
    )


def _pairs(nominal: States, guided: States) -> list[tuple[States, States]]:
    return [(nominal, guided), (nominal, nominal), (guided, guided)]


def deviation_of_theorem(
    guided: TabletopGenerator, condition: SceneCondition, samples: int, seed: int
) -> TheoremDeviation:
    """Both sides of the theorem over samples of one condition; steps are fixed, so that the sums contain all of them."""
    size, field = len(condition.objects), guided.field
    noise = initial_noise(seed, np.arange(samples), 0)[:, :size]
    arrays = take(to_arrays([condition], size), 0)  # without padding, which would count
    guidance = guided.guidance_for(condition)
    coupled = couple(field, guidance, jnp.asarray(noise), arrays, grid=guided.grid)
    rates = growth(field, coupled, arrays)
    ends = [np.asarray(path[:, -1]) for path in (coupled.nominal, coupled.guided)]
    poses = [np.stack([decode_exactly(z, condition) for z in end]) for end in ends]
    cross = squared_distances(*ends)
    largest = np.max(np.asarray(rates.lipschitz, np.float64), axis=0)
    return TheoremDeviation(
        samples,
        w2=wasserstein(cross),
        paired=float(np.sqrt(np.mean(np.diag(cross)))),
        log_bounds=bounds(coupled, rates),
        integral=float(trapezoid(largest, np.asarray(coupled.tau, np.float64))),
        largest=float(np.max(largest)),
        decoder=decoder_lipschitz(lambda z: decode(z, arrays), coupled.nominal[0, -1]),
        poses_w2=wasserstein(squared_distances(*poses)),
    )
