"""Projection of the predicted endpoint onto the constraints, by Gauss-Newton steps."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from deggflow.shapes import Scalar, States

from .baseline import AbstractStateless, Constraints, linearise, time_left

DAMPING = 1e-4  # on the diagonal, in the unit of |grad h|^2


class EndpointProjection(AbstractStateless):
    """Steers to the projection of the endpoint that the field predicts; z(1) is that projection after the last step.

    Inequalities have slack variables, h(x) - buffer = s^2. Each Gauss-Newton step is the shortest step in (x, s) that
    satisfies the linearised equations. The source resets the state to the straight line from z(0) to the projection;
    here, the state is steered to the projection from where it is. A central solver must know every agent's state and
    nominal field.

    Attributes:
        constraints: h.
        iterations: Number of Gauss-Newton steps per projection.
        start: tau from which on the endpoint is projected.
        buffer: Value of h that the method aims for.

    Source: physics-constrained flow matching, PCFM (Utkarsh et al., arXiv:2506.04171).
    """

    constraints: Constraints
    iterations: int = eqx.field(static=True, default=5)
    start: float | Scalar = 0.0
    buffer: float = eqx.field(static=True, default=0.0)

    def correction(self, tau: Scalar, z: States, drift: States, condition: Any) -> States:
        """The velocity that moves the predicted endpoint to its projection in the time left."""
        end = z + time_left(tau) * drift
        velocity = (self.project(end, condition) - end) / time_left(tau)
        return jnp.where(tau >= self.start, velocity, 0.0)

    def project(self, x: States, condition: Any) -> States:
        """A point near x where the constraints hold, if the iteration converges."""

        def step(_: Int[Array, ""], x: States) -> States:
            here = linearise(self.constraints, x, jnp.zeros_like(x), condition)
            excess = here.margin - self.buffer
            slope = here.slope.reshape(len(excess), -1)
            # (A A^T + D)^-1 with 4 s^2 of the slacks in D, solved in the dimensions of x, which are fewer than constraints.
            weight = 1 / (4 * jnp.maximum(excess, 0.0) + DAMPING)
            normal = slope.T @ (weight[:, None] * slope) + jnp.eye(slope.shape[1], dtype=x.dtype)
            pull = slope.T @ (weight * jnp.minimum(excess, 0.0))
            return x - jnp.linalg.solve(normal, pull).reshape(x.shape)

        return jax.lax.fori_loop(0, self.iterations, step, x)
