"""Projection of the predicted endpoint onto the constraints, by Gauss-Newton steps."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .baseline import AbstractStateless, Constraints, left, linearise

DAMPING = 1e-4  # on the diagonal, in the unit of |grad h|^2


class EndpointProjection(AbstractStateless):
    """Steers to the projection of the endpoint that the field predicts; after the last step z(1) is that projection.

    Inequalities get slack variables, h(x) - buffer = s^2, and each Gauss-Newton step is the smallest one in (x, s) to
    first order. The source resets the state to the straight line from z(0) to the projection; steered to it, as here,
    the state goes on from where it is. One solver must know every agent's state and nominal field.

    Args:
        constraints: h.
        iterations: Gauss-Newton steps each time.
        start: tau from which on the endpoint is projected.
        buffer: What is aimed at above h = 0.

    Source: physics-constrained flow matching, PCFM (Utkarsh et al., arXiv:2506.04171).
    """

    constraints: Constraints
    iterations: int = eqx.field(static=True, default=5)
    start: float | Float[Array, ""] = 0.0
    buffer: float = eqx.field(static=True, default=0.0)

    def correction(
        self,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, "agents dim"]:
        """From the predicted endpoint to its projection in the time left."""
        end = z + left(tau) * drift
        return jnp.where(tau >= self.start, (self.project(end, condition) - end) / left(tau), 0.0)

    def project(self, x: Float[Array, "agents dim"], condition: Any) -> Float[Array, "agents dim"]:
        """A point near x where the constraints hold, if the steps get there."""

        def step(_: Int[Array, ""], x: Float[Array, "agents dim"]) -> Float[Array, "agents dim"]:
            here = linearise(self.constraints, x, jnp.zeros_like(x), condition)
            spare = here.margin - self.buffer
            slope = here.slope.reshape(len(spare), -1)
            # (A A^T + D)^-1 with the slacks' 4 s^2 in D, solved in the few dimensions of x instead of one per constraint.
            weight = 1 / (4 * jnp.maximum(spare, 0.0) + DAMPING)
            normal = slope.T @ (weight[:, None] * slope) + jnp.eye(slope.shape[1], dtype=x.dtype)
            pull = slope.T @ (weight * jnp.minimum(spare, 0.0))
            return x - jnp.linalg.solve(normal, pull).reshape(x.shape)

        return jax.lax.fori_loop(0, self.iterations, step, x)
