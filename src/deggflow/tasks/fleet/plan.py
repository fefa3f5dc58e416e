"""A finished plan and its line in a file (format: JSON Lines, map units)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import Certificate

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
