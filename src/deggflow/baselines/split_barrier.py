"""Barrier rows split equally among the agents they involve, with a QP with slack for each agent."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.shapes import Scalar, States

from .barrier import AbstractBarrier
from .relaxed_qp import relaxed_input


class SplitBarrier(AbstractBarrier):
    """Each agent takes 1 / k of a row that involves k agents, with a slack where it cannot satisfy its part.

    The rows and the prescribed-time gain are those of `JointBarrier`. The source has a constant gain, with which nothing
    would guarantee that constraints hold at tau = 1. An agent must know the states and the nominal field of all agents
    that its constraints involve.

    Attributes:
        constraints: h.
        gain: The method's hyperparameter.
        buffer: Value of h that the method aims for.
        rows: Number of constraints in each agent's QP, the most violated ones.
        slack: Weight of the slack variables.

    Source: `dec_share_cbf` in the code of GCBF+ (Zhang et al., arXiv:2401.14554).
    """

    rows: int = eqx.field(static=True, default=8)
    slack: float = eqx.field(static=True, default=1e4)

    def correction(self, tau: Scalar, z: States, drift: States, condition: Any) -> States:
        """The solution of each agent's QP."""
        slope, b = self.barrier_rows(tau, z, drift, condition)
        involves = jnp.any(slope != 0, axis=-1)
        share = 1 / jnp.maximum(jnp.sum(involves, axis=-1), 1)

        def of_agent(own: Float[Array, "constraints dim"]) -> Float[Array, " dim"]:
            return relaxed_input(-own, share * b, rows=self.rows, slack=self.slack)

        return jax.vmap(of_agent, in_axes=1)(slope)
