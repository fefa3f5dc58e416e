"""A finished plan and its line in a file (format: JSON Lines, map units)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import Certificate
from deggflow.redraw import Drawn

from .condition import FleetCondition
from .verdict import Verdict, judge


def robot_names(count: int) -> list[str]:
    """What certificates call robots."""
    return [f"robot {k + 1}" for k in range(count)]


@dataclass(frozen=True)
class Plan:
    """Paths of all robots with their certificate.

    Attributes:
        condition: What they were generated for.
        paths: In map units, float64.
        certificate: What is said of them.
        seed: Of the run.
    """

    condition: FleetCondition
    paths: Float[np.ndarray, "robots 64 2"]
    certificate: Certificate
    seed: int

    def verdict(self) -> Verdict:
        """The verdict in closed form, regardless of the certificate."""
        return judge([self.condition], [self.paths])[0]

    def to_json(self) -> dict[str, Any]:
        """The plan as a JSON object."""
        return {
            "condition": self.condition.to_json(),
            "paths": self.paths.tolist(),
            "certificate": self.certificate.to_json(),
            "seed": self.seed,
        }


def finished(plans: Sequence[Drawn[Plan]]) -> list[Plan]:
    """Plans with the number of draws in their certificates."""
    return [with_draws(each.sample, each.draws) for each in plans]


def with_draws(plan: Plan, draws: int) -> Plan:
    """The plan with this number of draws in its certificate."""
    return replace(plan, certificate=replace(plan.certificate, draws=draws))
