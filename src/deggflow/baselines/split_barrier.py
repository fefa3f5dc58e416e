"""Barrier rows split equally between those whom they touch, each agent solving its own QP with slack."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .baseline import AbstractStateless, Constraints, left, linearise
from .relaxed_qp import relaxed_input


class SplitBarrier(AbstractStateless):
    """Each agent takes 1 / k of a row that touches k agents, and gives way by a slack where it can't.

    The rows are those of `JointBarrier`, and so is the prescribed-time gain, where the source has a constant one:
    with a constant gain nothing would have to hold at tau = 1. An agent must know the states and the nominal field
    of all whom its constraints touch.

    Args:
        constraints: h.
        gain: The method's hyperparameter.
        buffer: What is aimed at above h = 0.
        rows: Constraints that each agent looks at, the furthest from holding.
        slack: Weight of the slack variables.

    Source: `dec_share_cbf` in the code of GCBF+ (Zhang et al., arXiv:2401.14554).
    """

    constraints: Constraints
    gain: float | Float[Array, ""] = 1.0
    buffer: float = eqx.field(static=True, default=0.0)
    rows: int = eqx.field(static=True, default=8)
    slack: float = eqx.field(static=True, default=1e4)

    def correction(
        self,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, "agents dim"]:
        """Every agent's own solution."""
        here = linearise(self.constraints, z, drift, condition)
        touched = jnp.any(here.slope != 0, axis=-1)
        share = 1 / jnp.maximum(jnp.sum(touched, axis=-1), 1)
        b = -share * (here.rate + self.gain / left(tau) * (here.margin - self.buffer))

        def of_agent(slope: Float[Array, "constraints dim"]) -> Float[Array, " dim"]:
            return relaxed_input(-slope, b, rows=self.rows, slack=self.slack)

        return jax.vmap(of_agent, in_axes=1)(here.slope)
