"""Trials of nominal and guided policies from the same starts and z(0) (paper: tab:task1_results)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.drift import AbstractDrift
from deggflow.statistics import Rate, Row

from .condition import TrialCondition
from .expert import demonstrate, random_approach
from .field import BridgeField
from .generator import BridgeGenerator
from .options import BridgeEvaluate
from .oracle import refutation
from .policies import few_evaluations
from .requirements import bridge_guidance
from .scenes import random_conditions
from .trial import Trial
from .verdict import integrate
from .world import CONTACT_SIDE

KINDS = {
    "plank_leaves": "the plank leaves the workspace",
    "support_lost": "the plank loses its support",
    "robot_leaves": " leaves the workspace",
    "robot_in_gap": " enters the gap",
    "time_out": "not bridged after",
}
SYMMETRIC = TrialCondition(
    (-3.2, 0.0, 0.0),
    (-0.2, 0.0, 0.0),
    tuple((x, side * CONTACT_SIDE) for x in (-2.4, -1.4, -0.4) for side in (1.0, -1.0)),
)
SOURCES = ("demonstrations", "nominal", "guided")


def failure_kind(reason: str) -> str:
    """The key of `KINDS` that a nominal trial's reason belongs to; "other" if the generation diverged."""
    return next((kind for kind, text in KINDS.items() if text in reason), "other")


@dataclass(frozen=True)
class PolicyCounts:
    """Counts over all policies of some trials."""

    generated: int
    met_at_once: int  # first draws that end with both factors below their bounds
    met: int  # policies that do, redraws included
    most_draws: int

    def rate(self, count: int) -> Rate:
        """A count as a proportion of the policies."""
        return Rate(count, self.generated)


@dataclass(frozen=True)
class Evaluation(Row):
    """Results for one team size: counts out of `trials`."""

    size: int
    trials: int
    nominal: int  # trials in which the nominal policies bridge the gap
    failures: Mapping[str, int]  # of the nominal trials, by kind
    guided: int  # the same starts and z(0)
    blocked: Sequence[str]  # what guided trials that do not bridge say, with their numbers
    least_margin: float  # m, to any failure, over everything that guided trials executed
    policies: Mapping[str, PolicyCounts]  # "nominal" and "guided"
    refuted: Sequence[str]  # outcomes that the replay refutes, of either

    def rate(self, count: int) -> Rate:
        """A count as a proportion of the trials."""
        return Rate(count, self.trials)


def count_policies(trials: Sequence[Trial]) -> PolicyCounts:
    """Counts the policies of some trials whose factors both end below their bounds."""
    records = [record for trial in trials for record in trial.certificate.policies]
    successes = [record for record in records if record.met and record.accepted]
    return PolicyCounts(
        len(records),
        sum(record.draws == 1 for record in successes),
        len(successes),
        max((record.draws for record in records), default=0),
    )


def _refuted(name: str, trials: Sequence[Trial]) -> list[str]:
    texts = [refutation(trial.to_json()) for trial in trials]
    return [f"{name} trial {k}: {text}" for k, text in enumerate(texts, start=1) if text]


def evaluate(field: BridgeField, size: int, options: BridgeEvaluate) -> Evaluation:
    """Nominal and guided trials of one size, every outcome replayed by the oracle."""
    count, seed, drift = options.trials, options.seed, few_evaluations(options)
    conditions = random_conditions(size, count, seed)
    nominal = BridgeGenerator(field, drift=drift).trials(conditions, seed=seed)
    guided = BridgeGenerator(field, bridge_guidance(field.scales), drift=drift).trials(
        conditions, seed=seed, max_draws=options.max_draws
    )
    kinds = [failure_kind(trial.reason) for trial in nominal if trial.reason is not None]
    return Evaluation(
        size,
        count,
        nominal=sum(trial.success for trial in nominal),
        failures={kind: kinds.count(kind) for kind in (*KINDS, "other")},
        guided=sum(trial.success for trial in guided),
        blocked=[
            f"N = {size}, trial {k}: {trial.reason}"
            for k, trial in enumerate(guided, start=1)
            if not trial.success
        ],
        least_margin=min(trial.certificate.min_margin for trial in guided),
        policies={"nominal": count_policies(nominal), "guided": count_policies(guided)},
        refuted=_refuted(f"N = {size}, nominal", nominal) + _refuted(f"N = {size}, guided", guided),
    )


@dataclass(frozen=True)
class Modes(Row):
    """Sides on which planks pass from one symmetric start."""

    source: str
    trials: int
    bridged: int
    left: int  # the plank's centre is farthest from the straight path at y > 0
    low: float  # m, largest distance from the straight path: 5th percentile,
    median: float  # m, median,
    high: float  # m, and 95th percentile

    def rate(self, count: int) -> Rate:
        """A count as a proportion of the trials."""
        return Rate(count, self.trials)


class Passes(NamedTuple):
    """One path from the symmetric start."""

    poses: Float[np.ndarray, "poses 3"]
    bridged: bool


def demonstrated(count: int, seed: int) -> list[Passes]:
    """Paths of the expert from the symmetric start."""
    rng = np.random.default_rng([seed, 3])
    ways: list[Passes] = []
    while len(ways) < count:
        demonstration = demonstrate(SYMMETRIC, random_approach(rng))
        if demonstration is not None:
            twists, bridged = demonstration
            ways.append(Passes(integrate(np.array(SYMMETRIC.plank), twists[:bridged]), True))
    return ways


def passes(
    field: BridgeField,
    source: str,
    count: int,
    seed: int,
    max_draws: int,
    drift: AbstractDrift | None = None,
) -> list[Passes]:
    """Paths from the symmetric start by one of `SOURCES`."""
    if source == "demonstrations":
        return demonstrated(count, seed)
    guidance = bridge_guidance(field.scales) if source == "guided" else None
    generator = BridgeGenerator(field, guidance, drift=drift)
    trials = generator.trials([SYMMETRIC] * count, seed=seed, max_draws=max_draws)
    return [Passes(trial.poses, trial.success) for trial in trials]


def count_modes(source: str, ways: Sequence[Passes]) -> Modes:
    """Counts the passes on either side, with their distances."""
    y = [way.poses[:, 1] for way in ways]
    farthest = np.array([each[np.argmax(np.abs(each))] for each in y])
    low, median, high = np.percentile(np.abs(farthest), [5, 50, 95]).tolist()
    bridged = sum(way.bridged for way in ways)
    return Modes(source, len(ways), bridged, int(np.sum(farthest > 0)), low, median, high)
