"""Multistep methods of the predicted endpoint, which changes less along a generation than the field does."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from deggflow.shapes import Scalar, States
from deggflow.solver import Slope

from .base import Interval, macro_grid
from .multistep import AbstractMultistep, Differences, no_values, with_value

ENDPOINT_POWER = 2.5


class _Endpoint(NamedTuple):
    """The predicted endpoint as a polynomial.

    Attributes:
        differences: In tau, in Newton's form.
        start: tau at the start of the macro step.
        mean: What its drift has in common on all steps of the guidance.
        linear: Coefficient of 1 - tau.
        square: Coefficient of (1 - tau)^2.
    """

    differences: Differences
    start: Scalar
    mean: States
    linear: States
    square: States


@dataclass(frozen=True)
class ExtrapolatedEndpoint(AbstractMultistep):
    """The drift toward an extrapolated endpoint; of order 2, or nearly 3.

    Straight-line paths lead from z(0) to the endpoint x1, so that a field f predicts x1 = z + (1 - tau) f. Along a
    macro step x1 is a polynomial in tau through its last values, and the drift is the velocity of the exact solution of
    dz/dtau = (x1(tau) - z) / (1 - tau). With few evaluations this is closer to many steps than to extrapolate f itself
    (docs/guidance.md). It is exact where the field always predicts the same endpoint.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        order: Number of values that the polynomial goes through; fewer in the first macro steps.
        power: Of `macro_grid`.

    Source: data prediction of DPM-Solver++ (Lu et al., arXiv:2211.01095), for the straight-line path and in tau.
    """

    evaluations: int
    order: int = 3
    power: float = ENDPOINT_POWER

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """As many steps as evaluations."""
        return macro_grid(self.evaluations, self.power)

    def init(self, z0: States) -> _Endpoint:
        """No values."""
        zero = jnp.zeros_like(z0)
        return _Endpoint(no_values(self.order, z0), jnp.zeros((), z0.dtype), zero, zero, zero)

    def step(self, field: Slope, state: _Endpoint, interval: Interval, z: States) -> _Endpoint:
        """The polynomial with one more value, in powers of 1 - tau."""
        tau, _ = interval
        velocity = field(tau, z)
        differences = with_value(state.differences, tau, z + (1 - tau) * velocity)
        _, first, *higher = differences.of_order
        second = higher[0] if higher else jnp.zeros_like(z)
        left, before = 1 - differences.tau[0], 1 - differences.tau[1]
        return _Endpoint(
            differences,
            tau,
            mean=velocity + first + before * second,
            linear=-first - (left + before) * second,
            square=second,
        )

    def value(
        self, field: Slope, state: _Endpoint, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """The mean velocity of the exact solution over the interval.

        With q = 1 - tau, q0 that at the start of the macro step and the endpoint A + B q + C q^2, the solution is
        z = A + (z0 - A) q / q0 + B q ln(q0 / q) + C q (q0 - q).
        """
        whole, begin, end = 1 - state.start, 1 - interval[0], 1 - interval[1]

        def logarithmic(left: Scalar) -> Scalar:
            return left * jnp.log(whole / jnp.where(left > 0, left, 1.0))  # 0 at tau = 1

        slope = (logarithmic(end) - logarithmic(begin)) / (begin - end)
        return state.mean + slope * state.linear + (begin + end - whole) * state.square
