"""Policies from hard states: close to a wall or the gap, and in motion, before the bridge is built."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from deggflow.statistics import Rate, Row

from .condition import TrialCondition
from .factors import PLANK_BUFFER, ROBOT_BUFFER
from .field import BridgeField
from .generator import BridgeGenerator, Start
from .options import BridgeEvaluate
from .oracle import TOLERANCE, refine_replay, replay
from .policies import few_evaluations
from .requirements import bridge_guidance
from .scenes import random_condition
from .verdict import bridges, margins
from .world import (
    ANGULAR_SPEED,
    DT,
    GAP_RIGHT,
    HORIZON,
    LINEAR_SPEED,
    PLANK_LENGTH,
    X_MIN,
    Y_MAX,
    Y_MIN,
)

ROOM = 0.1  # m, largest distance of hard states to the factors' buffers, on either side
SWAY = np.radians(35.0)  # rad, either way
TRIES = 4096
AT_REST = 0.25  # proportion of states in which the plank is at rest


def hard_start(robots: int, rng: np.random.Generator) -> Start:
    """A state within `ROOM` of the factors' buffers, moving at up to the expert's speed limits in any direction."""
    condition = random_condition(robots, rng)
    low = [X_MIN, Y_MIN, -SWAY]
    high = [GAP_RIGHT - PLANK_LENGTH / 4, Y_MAX, SWAY]
    poses = rng.uniform(low, high, (TRIES, 3))
    distances = margins(poses, condition.contacts)
    robot = np.minimum(distances.wall.min(-1), distances.gap.min(-1)) - ROBOT_BUFFER
    room = np.minimum(np.minimum(distances.plank - PLANK_BUFFER, distances.support), robot)
    near = np.flatnonzero((np.abs(room) <= ROOM) & (distances.support >= 0) & ~bridges(poses))
    if not len(near):
        return hard_start(robots, rng)
    x, y, theta = poses[near[0]].tolist()
    direction = rng.uniform(-np.pi, np.pi)
    speed = LINEAR_SPEED * rng.uniform()
    twist = np.array([speed * np.cos(direction), speed * np.sin(direction), 0.0])
    twist[2] = rng.uniform(-ANGULAR_SPEED, ANGULAR_SPEED)
    twist = twist * (rng.uniform() >= AT_REST)
    # The previous policy slows down over its horizon.
    previous = np.linspace(1.0, 0.0, HORIZON)[:, None] * twist
    return Start(replace(condition, plank=(x, y, theta)), twist, previous)


def hard_starts(robots: int, count: int, seed: int) -> list[Start]:
    """States of a seed; each depends on its own number alone."""
    return [
        hard_start(robots, np.random.default_rng([seed, robots, number, 7]))
        for number in range(count)
    ]


@dataclass(frozen=True)
class HardPolicies(Row):
    """One policy from each of `states` hard states."""

    size: int
    states: int
    met_at_once: int  # first draws with both factors below their bounds, in float64
    accepted: int  # within the limit of draws, and nothing violated along the motion
    missed: int  # accepted although a factor ends above its bound
    refuted: int  # accepted although Shapely finds a violation along the motion
    hypotheses_hold: int  # accepted, and the hypotheses hold along the generation
    with_forced_steps: int  # accepted, with steps taken above a limit
    blocked: Mapping[str, int]  # reasons where no draw was accepted, without numbers
    excess: float  # largest by which a refused policy misses a bound

    def rate(self, count: int) -> Rate:
        """A count as a proportion of the states."""
        return Rate(count, self.states)


def evaluate_hard(field: BridgeField, size: int, options: BridgeEvaluate) -> HardPolicies:
    """Guided policies from hard states; each accepted one is replayed by the oracle."""
    states, drift = options.hard, few_evaluations(options)
    starts = hard_starts(size, states, options.seed)
    generator = BridgeGenerator(field, bridge_guidance(field.scales), drift=drift)
    policies = generator.single(starts, seed=options.seed, max_draws=options.max_draws)
    accepted = [each for each in policies if each.record.accepted]
    refused = [each for each in policies if not each.record.accepted]
    records = [each.record.generation for each in accepted]
    return HardPolicies(
        size,
        states,
        met_at_once=sum(each.first_met for each in policies),
        accepted=len(accepted),
        missed=sum(not each.record.met for each in accepted),
        refuted=sum(_broken(each.condition, each.twists) for each in accepted),
        hypotheses_hold=sum(record is not None and record.hypotheses_hold for record in records),
        with_forced_steps=sum(record is not None and record.forced_steps > 0 for record in records),
        blocked=dict(Counter(_kind(each.reason or "") for each in refused)),
        excess=max((each.record.excess for each in refused), default=0.0),
    )


def _broken(condition: TrialCondition, twists: Float[np.ndarray, "actions 3"]) -> bool:
    value = {"condition": condition.to_json(), "dt": DT, "twists": twists.tolist()}
    return not refine_replay(value, replay(value)).motion.least.min() >= -TOLERANCE


def _kind(reason: str) -> str:
    """Which factors are missed, without the numbers."""
    names = [name for name in ("q_task", "q_safe", "on the way") if name in reason]
    return " and ".join(names) or "diverged"


def blocked_texts(rows: Sequence[HardPolicies]) -> list[str]:
    """Reasons for states without an accepted policy, and their frequencies."""
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row.blocked)
    return [f"{kind}: {count}" for kind, count in total.most_common()]
