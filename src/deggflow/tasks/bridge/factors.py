"""The shared requirements of the team: q_task at the final pose, q_safe along the motion.

Source: paper, App. on Task 1 (task and safety factors).
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.shapes import Scalar

from .motion import rotate
from .world import (
    CORRIDOR,
    END_CLEARANCE,
    GAP_LEFT,
    GAP_RIGHT,
    PLANK_LENGTH,
    PLANK_WIDTH,
    ROBOT_RADIUS,
    SUPPORT,
    Y_MAX,
    Y_MIN,
)

T = TypeVar("T", float, Array)

EPSILON = 1e-6  # smooths |cos| and |sin|
TASK_SHARPNESS, SAFE_SHARPNESS = 80.0, 60.0
TASK_SCALES = (0.55, 0.55, 0.2, 0.2, 0.2, 0.2)  # m, of m^task_1, m^task_2, ...
SAFE_SCALE = 0.1  # m
PLANK_BUFFER, ROBOT_BUFFER = 0.2, 0.1  # m
EITHER_SIDE = 0.02  # m, width of the smooth maximum of the two supports


def _smooth_abs(value: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.sqrt(value**2 + EPSILON**2)


def _half_extents(theta: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """h_x and h_y: how far the plank reaches from its centre along the axes of the world, m."""
    cos, sin = _smooth_abs(jnp.cos(theta)), _smooth_abs(jnp.sin(theta))
    return (
        (PLANK_LENGTH * cos + PLANK_WIDTH * sin) / 2,
        (PLANK_LENGTH * sin + PLANK_WIDTH * cos) / 2,
    )


def task_margins(pose: Float[Array, " 3"]) -> Float[Array, " 6"]:
    """m^task: support left and right of the gap, corridor left and right, plank within both sides (m)."""
    x, y, theta = pose
    return jnp.stack(plank_margins(x, y, _half_extents(theta), _smooth_abs(jnp.cos(theta))))


def plank_margins(x: T, y: T, extents: tuple[T, T], cos: T) -> list[T]:
    """m^task in the order of `task_margins`, of arrays or of Python's numbers.

    Args:
        x: Of the plank's centre, m.
        y: Of the plank's centre, m.
        extents: h_x and h_y, m.
        cos: |cos| of its angle.
    """
    reach, side = extents
    corridor = (PLANK_LENGTH / 2 - ROBOT_RADIUS - END_CLEARANCE) * cos
    return [
        GAP_LEFT - x + reach - SUPPORT,
        x + reach - GAP_RIGHT - SUPPORT,
        GAP_LEFT - x + corridor - CORRIDOR,
        x + corridor - GAP_RIGHT - CORRIDOR,
        Y_MAX - y - side,
        y - side - Y_MIN,
    ]


def task_factor(pose: Float[Array, " 3"]) -> Scalar:
    """q_task: at most 0 only where the plank bridges the gap inside the workspace (within EPSILON m)."""
    ratios = task_margins(pose) / jnp.array(TASK_SCALES)
    return jax.nn.logsumexp(-TASK_SHARPNESS * ratios) / TASK_SHARPNESS


def safe_margins(
    pose: Float[Array, " 3"], centres: Float[Array, "agents 2"], mask: Bool[Array, " agents"]
) -> tuple[Float[Array, " 3"], Float[Array, "3 agents"]]:
    """m^safe at one pose, buffers taken off (m): of the plank, and of each robot (infinite if absent).

    The plank's: upper side, lower side, support on one of the grounds. A robot's: gap, upper side, lower
    side. `centres` are the robots' in the plank's frame.
    """
    x, y, theta = pose
    reach, side = _half_extents(theta)
    before, beyond = GAP_LEFT - x + reach - SUPPORT, x + reach - GAP_RIGHT - SUPPORT
    # A smooth maximum that never exceeds the maximum: where it is nonnegative, one of the two supports is.
    width = jnp.sqrt((before - beyond) ** 2 + EITHER_SIDE**2)
    support = (before + beyond + width - EITHER_SIDE) / 2
    plank = jnp.stack([Y_MAX - PLANK_BUFFER - y - side, y - side - PLANK_BUFFER - Y_MIN, support])
    place = pose[None, :2] + rotate(theta, centres)
    room = ROBOT_RADIUS + ROBOT_BUFFER
    robots = jnp.stack(
        [GAP_LEFT - room - place[:, 0], Y_MAX - room - place[:, 1], place[:, 1] - room - Y_MIN]
    )
    return plank, jnp.where(mask[None], robots, jnp.inf)


def safe_factor(
    poses: Float[Array, "actions 3"],
    centres: Float[Array, "agents 2"],
    mask: Bool[Array, " agents"],
) -> Scalar:
    """q_safe: at most 0 only where every safety margin holds at every pose."""
    plank, robots = jax.vmap(safe_margins, in_axes=(0, None, None))(poses, centres, mask)
    margins = jnp.concatenate([plank.reshape(-1), robots.reshape(-1)])
    return jax.nn.logsumexp(-SAFE_SHARPNESS * margins / SAFE_SCALE) / SAFE_SHARPNESS
