"""A finished scene and its line in a file (format: JSON Lines, SI units, radians)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import Certificate

from .condition import SceneCondition
from .verdict import Verdict, judge


@dataclass(frozen=True)
class Scene:
    """An arrangement of objects with its certificate."""

    condition: SceneCondition
    poses: Float[np.ndarray, "agents 3"]  # x, y in m, theta in rad
    certificate: Certificate
    seed: int

    def verdict(self) -> Verdict:
        """The verdict of exact geometry, regardless of the certificate."""
        return judge([self.condition], [self.poses])[0]

    def to_json(self) -> dict[str, Any]:
        """The scene as a JSON object."""
        objects = [
            {"name": name, "x": float(x), "y": float(y), "theta": float(theta)}
            for name, (x, y, theta) in zip(self.condition.objects, self.poses, strict=True)
        ]
        return {
            "condition": self.condition.to_json(),
            "objects": objects,
            "certificate": self.certificate.to_json(),
            "seed": self.seed,
        }
