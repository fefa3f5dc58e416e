"""Multipliers that evolve with the sample: saddle-point dynamics of a Lagrangian."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import GuidanceReport, report_without_rows
from deggflow.shapes import Mask, Scalar, States

from .baseline import AbstractBaseline, Constraints, of_moving, time_left


class Multipliers(NamedTuple):
    """The dual variables at the last point.

    Attributes:
        value: lambda, clipped to lambda >= 0 where it is used.
        rate: dlambda/dtau at this point.
        tau: tau of this point.
    """

    value: Float[Array, " constraints"]
    rate: Float[Array, " constraints"]
    tau: Scalar


class DualFlow(AbstractBaseline):
    """dz/dtau = f - sum_k lambda_k grad g_k / (1 - tau), dlambda_k/dtau = gain g_k / (1 - tau), lambda >= 0.

    The requirement is g = buffer - h <= 0. `damping` makes the Lagrangian an augmented one: damping [g_k]_+ is added to
    each multiplier, as such dynamics oscillate otherwise. Because of the division by 1 - tau, both converge in prescribed
    time. The multipliers are the state of the guidance, and are integrated from point to point by explicit Euler steps.
    Each agent needs the states and multipliers of its neighbours.

    Attributes:
        constraints: h.
        gain: Gain of the multipliers, the method's hyperparameter.
        damping: Weight of the augmented term.
        buffer: Value of h that the method aims for.

    Source: saddle-point dynamics (Arrow, Hurwicz, Uzawa, 1958) along a flow, as Lagrangian dual flows do.
    """

    constraints: Constraints
    gain: float | Scalar = 2.0
    damping: float | Scalar = 4.0
    buffer: float = eqx.field(static=True, default=0.0)

    def init(self, z0: States, condition: Any, mask: Mask = None) -> Multipliers:
        """Zero multipliers."""
        zero = jnp.zeros(jax.eval_shape(self.constraints, z0, condition).shape, z0.dtype)
        return Multipliers(zero, zero, jnp.zeros((), z0.dtype))

    def __call__(
        self,
        state: Multipliers,
        tau: Scalar,
        z: States,
        drift: States,
        condition: Any,
        moving: Mask = None,
    ) -> tuple[Multipliers, States, GuidanceReport]:
        """Gradient descent of the Lagrangian in the sample, gradient ascent in the multipliers."""
        margin, pull = jax.vjp(lambda x: self.constraints(x, condition), z)
        violation = self.buffer - margin
        value = state.value + (tau - state.tau) * state.rate
        multiplier = jnp.maximum(value, 0.0)
        weight = multiplier + self.damping * jnp.maximum(violation, 0.0)
        (descent,) = pull(weight / time_left(tau))
        grows = (violation > 0) | (multiplier > 0)
        rate = jnp.where(grows, self.gain / time_left(tau) * violation, 0.0)
        u = of_moving(descent, moving)
        return Multipliers(value, rate, tau), u, report_without_rows(drift, u)
