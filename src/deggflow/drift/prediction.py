"""Guidance after a prediction: the sample is carried to its nominal end first."""

from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.shapes import Scalar, States
from deggflow.solver import Slope

from .base import AbstractDrift, Interval


@dataclass(frozen=True)
class AfterPrediction(AbstractDrift):
    """No drift at all: guidance begins at the nominal sample of z(0), and moves only what violates a requirement.

    The generation's path, trace and certificate begin at the prediction. Its tau is that of the guidance, and so are the
    `stops` of agents.

    Attributes:
        prediction: By which the nominal sample is found, in one straight step for each macro step.
    """

    prediction: AbstractDrift
    step_evaluations: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if not self.prediction.step_evaluations:
            raise ValueError(
                "`prediction` must have steps of its own, such as `ExtrapolatedEndpoint(16)`, or `Held(100, power=1)` "
                f"for 100 Euler steps; got {self.prediction}."
            )

    @property
    def nominal(self) -> AbstractDrift:
        """That of the prediction."""
        return self.prediction

    def start(self, field: Slope, z0: States) -> States:
        """The nominal sample."""
        drift = self.prediction
        grid = jnp.asarray(drift.macro_grid(), z0.dtype)

        def step(
            carry: tuple[States, object], interval: Interval
        ) -> tuple[tuple[States, object], None]:
            z, state = carry
            tau, end = interval
            state = drift.step(field, state, interval, z)
            return (z + (end - tau) * drift.value(field, state, interval, tau, z), state), None

        (z, _), _ = jax.lax.scan(step, (z0, drift.init(z0)), (grid[:-1], grid[1:]))
        return z

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """One macro step."""
        return np.array([0.0, 1.0])

    def init(self, z0: States) -> States:
        """Zero; NaN where the prediction is not finite."""
        return z0 - z0

    def step(self, field: Slope, state: States, interval: Interval, z: States) -> States:
        """As before."""
        return state

    def value(
        self, field: Slope, state: States, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """Zero."""
        return state

    def field_evaluations(self, readings: Int[Array, "*samples"]) -> Int[Array, "*samples"]:
        """Those of the prediction."""
        return self.prediction.field_evaluations(readings)
