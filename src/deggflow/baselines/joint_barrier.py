"""One central QP over all agents: a single-agent barrier method applied to a team."""

from typing import Any

import equinox as eqx

from deggflow.shapes import Scalar, States

from .barrier import AbstractBarrier
from .relaxed_qp import relaxed_input


class JointBarrier(AbstractBarrier):
    """The smallest joint input under one barrier row per constraint: grad h . (f + u) >= -gain (h - buffer) / (1 - tau).

    If a row is satisfied throughout, its violation vanishes in prescribed time: (h - buffer) shrinks as (1 - tau)^gain.
    A central solver must know every agent's state and nominal field.

    Attributes:
        constraints: h.
        gain: The method's hyperparameter.
        buffer: Value of h that the method aims for.
        rows: Number of constraints in the QP, the most violated ones.
        slack: Weight of the slack variables, without which contradictory rows would have no solution.

    Source: flow matching barrier functions of SafeFlow (Dai et al., arXiv:2504.08661), for a team as a single agent.
    """

    rows: int = eqx.field(static=True, default=24)
    slack: float = eqx.field(static=True, default=1e4)

    def correction(self, tau: Scalar, z: States, drift: States, condition: Any) -> States:
        """The QP's solution: the inputs of all agents."""
        slope, b = self.barrier_rows(tau, z, drift, condition)
        ell = -slope.reshape(len(b), -1)
        return relaxed_input(ell, b, rows=self.rows, slack=self.slack).reshape(z.shape)
