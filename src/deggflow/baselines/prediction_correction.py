"""Prediction of the whole sample without guidance, followed by a guided correction."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.flow import Field
from deggflow.generation import Generation, generate_batch, refined_grid
from deggflow.guidance import AbstractGuidance, NoGuidance
from deggflow.shapes import Scalar, States
from deggflow.step_guard import StepGuard


class FadingField(eqx.Module):
    """pull (1 - s) f(s, z): the nominal field during the correction, whose time s restarts at zero.

    Attributes:
        field: Nominal vector field.
        pull: Strength of the nominal field at s = 0.
    """

    field: Field
    pull: float | Scalar

    def __call__(self, tau: Scalar, z: States, condition: Any) -> States:
        """The faded field at s = tau."""
        return self.pull * (1 - tau) * self.field(tau, z, condition)


def predict_then_correct(
    field: Field,
    corrector: AbstractGuidance,
    z0: Float[Array, "samples agents dim"],
    condition: Any,
    *,
    steps: int,
    pull: float | Scalar = 2.0,
    guard: StepGuard | None = None,
    keep_path: bool = False,
) -> Generation:
    """Half of the steps for a nominal generation, half for a correction of its end point; returns the correction.

    Args:
        field: Nominal vector field.
        corrector: Guidance of the correction; a joint barrier QP in the source, but any guidance is possible.
        z0: Initial samples.
        condition: Condition with a leading axis of samples.
        steps: Number of steps of both phases together; the correction's steps are refined toward its end.
        pull: Strength of the fading field; with zero, the correction moves only what violates a requirement.
        guard: Acceptance of the correction's steps.
        keep_path: Also return z at every grid point of the correction.

    Source: SafeFlowMatcher (Yang et al., arXiv:2509.24243).
    """
    half = steps // 2
    predicted = generate_batch(
        field, NoGuidance(), z0, condition, grid=jnp.linspace(0.0, 1.0, steps - half + 1)
    )
    fading = FadingField(field, pull)
    return generate_batch(
        fading, corrector, predicted.z, condition,
        grid=refined_grid(half), guard=guard, keep_path=keep_path,
    )  # fmt: skip
