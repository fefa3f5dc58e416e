"""First the whole sample without guidance, then a correction by some guidance."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.flow import Field
from deggflow.generation import Generation, generate_batch, refined_grid
from deggflow.guidance import AbstractGuidance, NoGuidance
from deggflow.step_guard import StepGuard


class FadingField(eqx.Module):
    """pull (1 - s) f(s, z): what is left of the nominal field in the correction, whose time s starts anew."""

    field: Field
    pull: float | Float[Array, ""]

    def __call__(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, "agents dim"]:
        """The faded field at s = tau."""
        return self.pull * (1 - tau) * self.field(tau, z, condition)


def predict_then_correct(
    field: Field,
    corrector: AbstractGuidance,
    z0: Float[Array, "samples agents dim"],
    condition: Any,
    *,
    steps: int,
    pull: float | Float[Array, ""] = 2.0,
    guard: StepGuard | None = None,
) -> Generation:
    """Half of the steps for the nominal generation, half for a correction of its end; returns the correction.

    Args:
        field: Nominal vector field.
        corrector: Guidance of the correction; the source's is a joint barrier QP, but any will do.
        z0: Initial samples.
        condition: With a leading axis of samples.
        steps: Of both phases together; those of the correction are refined toward its end.
        pull: How strongly the fading field acts; with zero the correction moves what must move alone.
        guard: Of the correction's steps.

    Source: SafeFlowMatcher (Yang et al., arXiv:2509.24243).
    """
    half = steps // 2
    predicted = generate_batch(
        field, NoGuidance(), z0, condition, grid=jnp.linspace(0.0, 1.0, steps - half + 1)
    )
    fading = FadingField(field, pull)
    return generate_batch(
        fading, corrector, predicted.z, condition, grid=refined_grid(half), guard=guard
    )
