"""The bridge's guidance: q_task and q_safe of the actions that will be executed, shared by all robots."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import (
    AbstractSharing,
    AdaptiveShares,
    DecoupledGuidance,
    Recovering,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
)

from .codec import decode_twists
from .condition import BridgeCondition, Scales, centres
from .factors import safe_factor, task_factor
from .motion import integrate
from .world import DT, EXECUTED

PROGRESS = 0.05  # by which a policy must lower q_task
LEAST_START = 0.02  # the task's bound starts at least this much above its end
RECOVERY = (
    40.0  # gain above a bound: what one step of 1/50 lands above it, the next takes back by 4/5
)


class TaskValue(eqx.Module):
    """q_task at the pose after the executed actions."""

    scales: Scales = eqx.field(static=True)

    def __call__(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: BridgeCondition
    ) -> Float[Array, ""]:
        """q_task(z | chi); tau does not enter."""
        twists = decode_twists(z, condition, self.scales, EXECUTED)
        return task_factor(integrate(condition.plank, twists, DT)[-1])


class SafeValue(eqx.Module):
    """q_safe along the executed actions."""

    scales: Scales = eqx.field(static=True)

    def __call__(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: BridgeCondition
    ) -> Float[Array, ""]:
        """q_safe(z | chi); tau does not enter."""
        twists = decode_twists(z, condition, self.scales, EXECUTED)
        poses = integrate(condition.plank, twists, DT)
        return safe_factor(poses, centres(condition.contacts), condition.mask)


def task_end(condition: BridgeCondition) -> Float[Array, ""]:
    """beta_task(1): the present value of q_task less the progress asked for."""
    return task_factor(condition.plank) - PROGRESS


def bridge_requirements(
    scales: Scales, sharing: AbstractSharing | None = None
) -> SharedRequirements:
    """q_task and q_safe under their bounds (paper, App. on Task 1)."""
    alpha = Recovering(RECOVERY)
    task = SharedFactor(
        TaskValue(scales),
        TighteningBound(end=task_end, least=LEAST_START),
        alpha=alpha,
        name="q_task",
    )
    safe = SharedFactor(SafeValue(scales), TighteningBound(), alpha=alpha, name="q_safe")
    return SharedRequirements((task, safe), AdaptiveShares() if sharing is None else sharing)


def bridge_guidance(scales: Scales, sharing: AbstractSharing | None = None) -> DecoupledGuidance:
    """Guidance for the bridge, g_i = I and H_i = I.

    Args:
        scales: Of the field's training set, as the decoder needs them.
        sharing: Weights of the robots; adaptive ones (the paper's) if None.
    """
    return DecoupledGuidance((bridge_requirements(scales, sharing),))


def final_values(
    z: Float[Array, "agents dim"], condition: BridgeCondition, scales: Scales
) -> Float[Array, " 3"]:
    """q_task(z(1)), beta_task(1) and q_safe(z(1)); beta_safe(1) is 0."""
    tau = jnp.ones((), z.dtype)
    return jnp.stack(
        [
            TaskValue(scales)(tau, z, condition),
            task_end(condition),
            SafeValue(scales)(tau, z, condition),
        ]
    )
