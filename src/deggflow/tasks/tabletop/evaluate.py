"""Success rates of nominal and guided generation on random cases (paper: tables of Task 2)."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.flow import Field
from deggflow.statistics import Rate

from .changes import random_conditions
from .condition import SceneCondition
from .generator import (
    LOCAL,
    OWN,
    POOLED,
    TabletopGenerator,
    initial_noise,
    tabletop_guidance,
)
from .oracle import refutes
from .verdict import Verdict, judge

ALLOCATIONS = {"own": OWN, "pooled": POOLED, "local": LOCAL}


@dataclass(frozen=True)
class Evaluation:
    """One size and one family of requirements: counts out of `cases`."""

    size: int
    requirements: str
    cases: int
    natural: int  # nominal scenes that satisfy the default requirements
    private: int  # the same scenes under the changed requirements
    first_draw: int  # guided from the same z(0)
    satisfied: int  # guided, within the limit of draws
    most_draws: int
    least_margin: float  # m, over the guided scenes that were claimed satisfied
    refuted: int  # claims that Shapely refutes

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return asdict(self)

    def rate(self, count: int) -> Rate:
        """A count as a share of the cases."""
        return Rate(count, self.cases)


@dataclass(frozen=True)
class Comparison:
    """One way to guide, one size: first draws from the same z(0) as every other way."""

    size: int
    allocation: str
    reanchored: bool
    cases: int
    first_draw: int
    least_margin: float  # m, over all cases
    deviation: float  # RMS distance to the nominal sample, in z, per agent

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return asdict(self)

    def rate(self) -> Rate:
        """First-draw success."""
        return Rate(self.first_draw, self.cases)


def _count(verdicts: Sequence[Verdict]) -> int:
    return sum(verdict.satisfied for verdict in verdicts)


def evaluate(
    field: Field, size: int, requirements: str, cases: int, seed: int, max_draws: int
) -> Evaluation:
    """Nominal and guided scenes of random cases, every claim checked by Shapely."""
    conditions = random_conditions(size, cases, requirements, seed)
    nominal = TabletopGenerator(field).batch(initial_noise(seed, np.arange(cases), 0), conditions)
    default = [condition.with_requirements({}) for condition in conditions]
    guided = TabletopGenerator(field, tabletop_guidance()).scenes(
        conditions, seed=seed, max_draws=max_draws
    )
    claimed = [scene for scene in guided if scene.certificate.satisfied]
    return Evaluation(
        size,
        requirements,
        cases,
        natural=_count(judge(default, nominal.poses)),
        private=_count(judge(conditions, nominal.poses)),
        first_draw=sum(scene.certificate.draws == 1 for scene in claimed),
        satisfied=len(claimed),
        most_draws=max(scene.certificate.draws for scene in guided),
        least_margin=min((s.certificate.min_margin for s in claimed), default=float("nan")),
        refuted=sum(refutes(scene.condition, scene.poses) for scene in claimed),
    )


def _deviation(
    guided: Float[np.ndarray, "scenes agents 3"],
    nominal: Float[np.ndarray, "scenes agents 3"],
    conditions: Sequence[SceneCondition],
) -> float:
    size = len(conditions[0].objects)
    return float(np.sqrt(np.mean(np.sum((guided - nominal)[:, :size] ** 2, axis=-1))))


def compare(
    field: Field,
    size: int,
    requirements: str,
    cases: int,
    seed: int,
    *,
    allocation: str,
    reanchored: bool,
) -> Comparison:
    """First draws of one way to guide."""
    conditions = random_conditions(size, cases, requirements, seed)
    noise = initial_noise(seed, np.arange(cases), 0)
    guidance = tabletop_guidance(ALLOCATIONS[allocation], reanchored=reanchored)
    nominal = TabletopGenerator(field).batch(noise, conditions)
    guided = TabletopGenerator(field, guidance).batch(noise, conditions)
    verdicts = judge(conditions, guided.poses)
    return Comparison(
        size,
        allocation,
        reanchored,
        cases,
        first_draw=_count(verdicts),
        least_margin=min(verdict.min_margin for verdict in verdicts),
        deviation=_deviation(guided.z, nominal.z, conditions),
    )
