"""Descent on the violation, with a gain that grows toward tau = 1."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from deggflow.shapes import AgentValues, Scalar, States

from .baseline import AbstractStateless, time_left

Violation = Callable[[States, Any], AgentValues]
"""V_i: (z, condition) -> the violation of each agent."""


class PenaltyGradient(AbstractStateless):
    """u = -gain / (1 - tau) grad V: the most common choice, and the strongest of the simple methods.

    Each agent needs the states of its neighbours. No theory determines a sufficient gain.

    Attributes:
        violation: V_i of each agent.
        gain: The method's hyperparameter; V has the unit of its margins squared.

    Source: gradient guidance, e.g. universal guidance (Bansal et al., 2024), guided flow matching (Feng et al., 2025).
    """

    violation: Violation
    gain: float | Scalar = 20.0

    def correction(self, tau: Scalar, z: States, drift: States, condition: Any) -> States:
        """Gradient descent, faster as less time is left."""

        def total(z: States) -> Scalar:
            return jnp.sum(self.violation(z, condition))

        return -self.gain / time_left(tau) * jax.grad(total)(z)
