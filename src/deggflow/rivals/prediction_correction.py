"""First the whole sample without guidance, then a correction by barriers."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.flow import Field
from deggflow.generation import refined_grid

from .joint_barrier import JointBarrier
from .rival import AbstractRival

MIDDLE = 0.5  # tau up to which is predicted


class PredictionCorrection(AbstractRival):
    """tau in [0, 1/2] is the nominal generation, twice as fast; tau in [1/2, 1] corrects its end by `JointBarrier`.

    In the correction the time s = 2 tau - 1 starts anew and the field fades: pull (1 - s) f(s, z). Needs `wrap` for
    the field and `grid` for the steps.

    Args:
        barrier: The correction's QP.
        pull: How strongly the fading field acts.

    Source: SafeFlowMatcher (Yang et al., arXiv:2509.24243).
    """

    barrier: JointBarrier
    pull: float | Float[Array, ""] = 2.0

    def grid(self, steps: int) -> Float[Array, " points"]:
        """Half of the steps for the prediction, half for the correction, those refined toward its end."""
        predicted = MIDDLE * jnp.linspace(0.0, 1.0, steps - steps // 2 + 1)
        return jnp.concatenate([predicted, MIDDLE + MIDDLE * refined_grid(steps // 2)[1:]])

    def wrap(self, field: Field) -> Field:
        """The field of both phases in one."""

        def phases(
            tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
        ) -> Float[Array, "agents dim"]:
            corrects = tau >= MIDDLE
            time = jnp.where(corrects, tau - MIDDLE, tau) / MIDDLE
            strength = jnp.where(corrects, self.pull * (1 - time), 1.0)
            return strength / MIDDLE * field(time, z, condition)

        return phases

    def correction(
        self,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, "agents dim"]:
        """Nothing at first; then the barrier's input."""
        time = (tau - MIDDLE) / MIDDLE
        u = self.barrier.correction(time, z, MIDDLE * drift, condition) / MIDDLE
        return jnp.where(tau >= MIDDLE, u, 0.0)
