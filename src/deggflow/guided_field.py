"""dz/dtau of one sample: nominal drift and guidance."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .arguments import checked_drift
from .drift import AbstractDrift
from .flow import Field
from .guidance import AbstractGuidance, GuidanceReport
from .shapes import Mask, Scalar, States
from .solver import Slope

Velocity = Callable[
    [Any, Int[Array, ""], Scalar, States],
    tuple[Any, States, GuidanceReport],
]
"""(state of the guidance, index of the grid's step, tau, z) -> the state after this point, dz/dtau, and what the guidance reports."""


class GuidedField(NamedTuple):
    """Field and guidance of one sample, on a grid."""

    field: Field
    guidance: AbstractGuidance
    drift: AbstractDrift
    grid: Float[Array, " points"]
    condition: Any
    mask: Mask
    stops: Float[Array, " agents"] | None

    @property
    def nominal(self) -> Slope:
        """The field, whose value is checked."""
        return lambda tau, z: checked_drift(self.field(tau, z, self.condition), z)

    def start(self, z0: States) -> States:
        """Where the guided generation begins, from z(0); absent agents stay there, and so do those with a negative stop."""
        present = self.mask
        if self.stops is not None:
            present = self.stops >= 0 if present is None else present & (self.stops >= 0)

        def slope(tau: Scalar, z: States) -> States:
            value = self.nominal(tau, z)
            return value if present is None else jnp.where(present[:, None], value, 0.0)

        return self.drift.start(slope, z0)

    def velocity(self, drift_state: Any) -> Velocity:
        """dz/dtau of the guided field, where the drift is in this state."""

        def velocity(
            state: Any, step: Int[Array, ""], tau: Scalar, z: States
        ) -> tuple[Any, States, GuidanceReport]:
            step = jnp.minimum(step, len(self.grid) - 2)  # none begins at tau = 1
            interval = self.grid[step], self.grid[step + 1]
            drift = self.drift.value(self.nominal, drift_state, interval, tau, z)
            moving = self.mask
            if self.stops is not None:
                moving = tau < self.stops if moving is None else moving & (tau < self.stops)
            if moving is None:
                state, correction, report = self.guidance(state, tau, z, drift, self.condition)
                return state, drift + correction, report
            drift = jnp.where(moving[:, None], drift, 0.0)
            state, correction, report = self.guidance(state, tau, z, drift, self.condition, moving)
            return state, drift + jnp.where(moving[:, None], correction, 0.0), report

        return velocity
