"""Barrier rows with a prescribed-time gain, which the baselines' QPs solve."""

from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from deggflow.shapes import Scalar, States

from .baseline import AbstractStateless, Constraints, linearise, time_left


class BarrierRows(NamedTuple):
    """Rows `slope . u >= b`, one for each constraint.

    Attributes:
        slope: grad h.
        b: -grad h . f - gain (h - buffer) / (1 - tau).
    """

    slope: Float[Array, "constraints agents dim"]
    b: Float[Array, " constraints"]


class AbstractBarrier(AbstractStateless):
    """A baseline with one barrier row per constraint: grad h . (f + u) >= -gain (h - buffer) / (1 - tau).

    If a row is satisfied throughout, its violation vanishes in prescribed time: (h - buffer) shrinks as (1 - tau)^gain.

    Attributes:
        constraints: h.
        gain: The method's hyperparameter.
        buffer: Value of h that the method aims for.
    """

    constraints: Constraints
    gain: float | Scalar = 1.0
    buffer: float = eqx.field(static=True, default=0.0)

    def barrier_rows(self, tau: Scalar, z: States, drift: States, condition: Any) -> BarrierRows:
        """The rows at one state."""
        here = linearise(self.constraints, z, drift, condition)
        b = -(here.rate + self.gain / time_left(tau) * (here.margin - self.buffer))
        return BarrierRows(here.slope, b)
