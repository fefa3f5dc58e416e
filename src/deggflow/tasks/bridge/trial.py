"""A finished trial: executed actions, outcome and certificate."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import GenerationRecord, columns, with_generation

from .condition import TrialCondition
from .world import DT, EXECUTED

MAX_SPEED = 100.0  # m/s and rad/s; faster motion has diverged, and is not stored in files


@dataclass(frozen=True)
class PolicyRecord:
    """One generated policy at tau = 1, in float64, accepted or refused."""

    q_task: float
    bound: float  # beta_task(1): q_task before, less the required progress
    q_safe: float  # its bound is 0
    draws: int  # initial samples tried
    accepted: bool
    speed: float = 0.0  # m/s, largest of a contact point in the actions that are executed
    generation: GenerationRecord | None = None  # None without guidance

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return with_generation(asdict(self), self.generation)

    @property
    def excess(self) -> float:
        """By how much a factor ends above its bound; 0 if none does."""
        return max(self.q_task - self.bound, self.q_safe, 0.0)

    @property
    def met(self) -> bool:
        """Whether both factors are below their bounds."""
        return self.q_task <= self.bound and self.q_safe <= 0.0


@dataclass(frozen=True)
class TrialCertificate:
    """The verdict on a trial, in float64 by exact geometry, and its policies."""

    satisfied: bool  # the gap was bridged, nothing failed, and every executed policy met its bounds
    min_margin: float  # m, least distance to a failure over everything executed
    violation: float  # largest excess of a factor over its bound at the end of an executed policy
    draws: int  # most initial samples tried for one policy
    reason: str | None  # which factor and which robots, if not satisfied
    policies: tuple[PolicyRecord, ...]
    speed_limit: float | None = None  # m/s, of every contact point; None if there was none

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        out = {**asdict(self), "policies": [policy.to_json() for policy in self.policies]}
        if self.speed_limit is None:
            del out["speed_limit"]
        return out

    def table(self) -> str:
        """The certificate as a readable table, one line per policy."""
        head = "satisfied" if self.satisfied else f"NOT satisfied: {self.reason}"
        limit = "" if self.speed_limit is None else f", speed limit {self.speed_limit:g} m/s"
        lines = [f"{head}; least margin {self.min_margin:.3f} m{limit}"]
        heads = (
            "policy", "q_task", "bound", "q_safe", "draws", "m/s",
            "hypotheses hold", "steps, refused, forced", "least opposed sine", "largest |u|",
        )  # fmt: skip
        rows = [heads, *(_row(k, policy) for k, policy in enumerate(self.policies, start=1))]
        return "\n".join([*lines, *columns(rows)])


def _row(number: int, policy: PolicyRecord) -> tuple[str, ...]:
    record = policy.generation
    on_the_way = ("-", "-", "-", "-")
    if record is not None:
        sine = "-" if record.least_opposed_sine is None else f"{record.least_opposed_sine:.2g}"
        steps = f"{record.steps}, {record.refused_steps}, {record.forced_steps}"
        hold = "yes" if record.hypotheses_hold else "no"
        on_the_way = (hold, steps, sine, f"{record.largest_input_norm:.3g}")
    return (
        f"{number}" if policy.accepted else f"{number} (refused)",
        f"{policy.q_task:.4f}",
        f"{policy.bound:.4f}",
        f"{policy.q_safe:.4f}",
        f"{policy.draws}",
        f"{policy.speed:.3f}",
        *on_the_way,
    )


@dataclass(frozen=True)
class Trial:
    """A trial from its initial pose to the first pose that bridges the gap or fails, or where the team stopped."""

    condition: TrialCondition
    twists: Float[np.ndarray, "actions 3"]  # m/s, m/s, rad/s, plank frame
    poses: Float[np.ndarray, "poses 3"]  # m, m, rad; one more than actions
    success: bool
    reason: str | None
    certificate: TrialCertificate
    seed: int

    def lost_robots(self) -> dict[int, int]:
        """Robots whose processes were lost, from 0, and how many actions had been executed by then."""
        numbers = {f"robot {k + 1}": k for k in range(len(self.condition.contacts))}
        lost: dict[int, int] = {}
        executed = 0
        for policy in self.certificate.policies:
            for one in () if policy.generation is None else policy.generation.lost:
                if one.agent in numbers:
                    lost.setdefault(numbers[one.agent], executed)
            executed += EXECUTED if policy.accepted else 0
        return lost

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return {
            "condition": self.condition.to_json(),
            "dt": DT,
            "twists": self.twists.tolist(),
            "poses": self.poses.tolist(),
            "outcome": {"success": self.success, "reason": self.reason},
            "certificate": self.certificate.to_json(),
            "seed": self.seed,
        }
