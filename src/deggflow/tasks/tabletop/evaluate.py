"""Success rates of nominal and guided generation on random cases (paper: tables of Task 2)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import Certificate
from deggflow.drift import AbstractDrift
from deggflow.flow import Field
from deggflow.statistics import CaseRow, Rate, Row

from .changes import random_conditions
from .condition import SceneCondition
from .generator import TabletopGenerator, initial_noise
from .oracle import refutes
from .requirements import LOCAL, OWN, POOLED, tabletop_guidance
from .scene import Scene
from .verdict import Verdict, judge

ALLOCATIONS = {"own": OWN, "pooled": POOLED, "local": LOCAL}


@dataclass(frozen=True)
class Evaluation(CaseRow):
    """One size and one family of requirements: counts out of `cases`."""

    size: int
    requirements: str
    cases: int
    nominal_default: int  # nominal scenes that satisfy the default requirements
    nominal_changed: int  # the same scenes under the changed requirements
    first_draw: int  # guided from the same z(0)
    satisfied: int  # guided, within the limit of draws
    most_draws: int
    least_margin: float | None  # m, over the guided scenes that were claimed satisfied
    refuted: int  # claims that Shapely refutes
    hypotheses_hold: int  # first draws along which the hypotheses of the theorem hold
    contradicted: int  # of these, draws that the verdict refuses nevertheless
    evaluations: Sequence[float]  # of the guided field: median, 99% quantile, most
    with_forced_steps: int  # first draws with a step that had to be taken above its limit


@dataclass(frozen=True)
class Comparison(Row):
    """One guidance and one size: first draws from the same z(0) as those of every other guidance."""

    size: int
    allocation: str
    reanchored: bool
    cases: int
    first_draw: int
    least_margin: float  # m, over all cases
    deviation: float  # RMS distance to the nominal sample, in z, per agent

    def rate(self) -> Rate:
        """First-draw success."""
        return Rate(self.first_draw, self.cases)


def _count(verdicts: Sequence[Verdict]) -> int:
    return sum(verdict.satisfied for verdict in verdicts)


@dataclass(frozen=True)
class Failure:
    """A draw that its verdict refused."""

    number: int  # of the case in the run
    scene: Scene

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return {"number": self.number, "scene": self.scene.to_json()}


def _nobody(failure: Failure) -> None:
    """Ignores failures."""


def evaluate(
    field: Field,
    size: int,
    requirements: str,
    cases: int,
    seed: int,
    max_draws: int,
    *,
    drift: AbstractDrift | None = None,
    on_failure: Callable[[Failure], None] = _nobody,
) -> Evaluation:
    """Nominal and guided scenes of random cases, every claim checked by Shapely.

    `on_failure` is called with every guided draw that its verdict refuses.
    """
    conditions = random_conditions(size, cases, requirements, seed)
    noise = initial_noise(seed, np.arange(cases), 0)
    nominal = TabletopGenerator(field, drift=drift).batch(noise, conditions)
    default = [replace(c, requirements={}, balance=None, given=None) for c in conditions]
    first: list[Certificate] = []

    def look(number: int, scene: Scene) -> None:
        if scene.certificate.draws == 1:
            first.append(scene.certificate)
        if not scene.certificate.satisfied:
            on_failure(Failure(number, scene))

    guided = TabletopGenerator(field, tabletop_guidance(), drift=drift).scenes(
        conditions, seed=seed, max_draws=max_draws, on_draw=look
    )
    claimed = [scene for scene in guided if scene.certificate.satisfied]
    records = [each.generation for each in first if each.generation is not None]
    evaluations = np.array([each.steps + each.refused_steps + 1 for each in records])
    hold = [
        each for each in first if each.generation is not None and each.generation.hypotheses_hold
    ]
    return Evaluation(
        size,
        requirements,
        cases,
        nominal_default=_count(judge(default, nominal.poses)),
        nominal_changed=_count(judge(conditions, nominal.poses)),
        first_draw=sum(each.satisfied for each in first),
        satisfied=len(claimed),
        most_draws=max(scene.certificate.draws for scene in guided),
        least_margin=min((s.certificate.min_margin for s in claimed), default=None),
        refuted=sum(refutes(scene.condition, scene.poses) for scene in claimed),
        hypotheses_hold=len(hold),
        contradicted=sum(not each.satisfied for each in hold),
        evaluations=(
            float(np.median(evaluations)),
            float(np.quantile(evaluations, 0.99)),
            float(evaluations.max()),
        ),
        with_forced_steps=sum(each.forced_steps > 0 for each in records),
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
    drift: AbstractDrift | None = None,
) -> Comparison:
    """First draws of one guidance with fixed steps, so that only the guidance differs."""
    conditions = random_conditions(size, cases, requirements, seed)
    noise = initial_noise(seed, np.arange(cases), 0)
    guidance = tabletop_guidance(ALLOCATIONS[allocation], reanchored=reanchored)
    nominal = TabletopGenerator(field, drift=drift).batch(noise, conditions)
    guided = TabletopGenerator(field, guidance, drift=drift, guard=None).batch(noise, conditions)
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
