"""The bridge's guidance: requirements on the executed actions.

q_task and q_safe are shared by all robots; a speed limit is each robot's own.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import (
    AbstractRequirement,
    DecoupledGuidance,
    PrivateRequirement,
    Recovering,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
)
from deggflow.shapes import Scalar, States

from .codec import executed_twists
from .condition import BridgeCondition, Scales, centres
from .factors import safe_factor, task_factor
from .motion import contact_velocity, integrate
from .world import DT

PROGRESS = 0.05  # by which a policy must lower q_task
LEAST_START = 0.02  # the task's bound starts at least this much above its end
RECOVERY = 40.0  # gain above a bound: a step of 1/50 reduces an excess by 4/5


class TaskValue(eqx.Module):
    """q_task at the pose after the executed actions."""

    scales: Scales = eqx.field(static=True)

    def __call__(self, tau: Scalar, z: States, condition: BridgeCondition) -> Scalar:
        """q_task(z | chi); tau does not enter."""
        twists = executed_twists(z, condition, self.scales)
        return task_factor(integrate(condition.plank, twists, DT)[-1])


class SafeValue(eqx.Module):
    """q_safe along the executed actions."""

    scales: Scales = eqx.field(static=True)

    def __call__(self, tau: Scalar, z: States, condition: BridgeCondition) -> Scalar:
        """q_safe(z | chi); tau does not enter."""
        twists = executed_twists(z, condition, self.scales)
        poses = integrate(condition.plank, twists, DT)
        return safe_factor(poses, centres(condition.contacts), condition.mask)


def task_end(condition: BridgeCondition) -> Scalar:
    """beta_task(1): the current value of q_task less the required progress."""
    return task_factor(condition.plank) - PROGRESS


def bridge_requirements(scales: Scales) -> SharedRequirements:
    """q_task and q_safe under their bounds (paper, App. on Task 1)."""
    alpha = Recovering(RECOVERY)
    task = SharedFactor(
        TaskValue(scales),
        TighteningBound(end=task_end, least=LEAST_START),
        alpha=alpha,
        name="q_task",
    )
    safe = SharedFactor(SafeValue(scales), TighteningBound(), alpha=alpha, name="q_safe")
    return SharedRequirements((task, safe))


SPEED_BUFFER = 0.02  # m/s, delta of the hinge


class SpeedMargins(eqx.Module):
    """Margins of a robot's own speed limit in each executed action, m/s.

    h_it = (limit^2 - |c_it|^2) / (2 limit) is nonnegative where the contact point's speed |c_it| is at most the
    limit, close to it the difference of the two, and smooth where the robot stands still.
    """

    scales: Scales = eqx.field(static=True)
    limit: float = eqx.field(static=True)  # m/s

    def __call__(self, z: States, condition: BridgeCondition) -> Float[Array, "agents actions"]:
        """h_it of every robot; infinite for absent ones."""
        twists = executed_twists(z, condition, self.scales)
        velocity = contact_velocity(twists[None], condition.contacts[:, None])
        margin = (self.limit**2 - jnp.sum(velocity**2, axis=-1)) / (2 * self.limit)
        return jnp.where(condition.mask[:, None], margin, jnp.inf)


def bridge_guidance(scales: Scales, *, speed_limit: float | None = None) -> DecoupledGuidance:
    """Guidance for the bridge, g_i = I and H_i = I.

    Args:
        scales: Of the field's training set, as the decoder needs them.
        speed_limit: Of each robot's contact point (m/s), private to the robot; None for no limit.
    """
    requirements: list[AbstractRequirement] = [bridge_requirements(scales)]
    if speed_limit is not None:
        margins = SpeedMargins(scales, speed_limit)
        requirements.append(PrivateRequirement(margins, SPEED_BUFFER, name="speed"))
    return DecoupledGuidance(tuple(requirements))


def final_values(z: States, condition: BridgeCondition, scales: Scales) -> Float[Array, " 3"]:
    """q_task(z(1)), beta_task(1) and q_safe(z(1)); beta_safe(1) is 0."""
    tau = jnp.ones((), z.dtype)
    return jnp.stack(
        [
            TaskValue(scales)(tau, z, condition),
            task_end(condition),
            SafeValue(scales)(tau, z, condition),
        ]
    )
