"""Conversion between generative states and object poses (paper: Appendix on Task 2)."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .condition import Parts, SceneCondition, TabletopCondition
from .geometry import RoundedBox

ANGLE_SCALE = (
    1.35  # rad per unit of z; positions scale with the table's half sizes, 0.70 and 0.47 m
)


class Pose(NamedTuple):
    """Poses of the objects of one scene."""

    x: Float[Array, "agents *samples"]  # m
    y: Float[Array, "agents *samples"]  # m
    theta: Float[Array, "agents *samples"]  # rad, not wrapped


def decode(z: Float[Array, "agents 3 *samples"], condition: TabletopCondition) -> Pose:
    """The decoder: diag(half width, half depth, 1.35) z; the paper's on the paper's table."""
    return Pose(
        jnp.asarray(condition.half_width)[None] * z[:, 0],
        jnp.asarray(condition.half_depth)[None] * z[:, 1],
        ANGLE_SCALE * z[:, 2],
    )


def decode_exactly(
    z: Float[np.ndarray, "agents 3"], condition: SceneCondition
) -> Float[np.ndarray, "objects 3"]:
    """`decode` in float64 without the padding: x, y in m and theta in rad of each object."""
    half = (
        np.array([condition.width, condition.depth], np.float32) / 2
    )  # as compiled programs know it
    scale = np.array([[*half.astype(np.float64), ANGLE_SCALE]])
    return z[: len(condition.objects)].astype(np.float64) * scale


def encode(pose: Pose, condition: TabletopCondition) -> Float[Array, "agents 3"]:
    """The encoder, inverse of `decode`."""
    return jnp.stack(
        [pose.x / condition.half_width, pose.y / condition.half_depth, pose.theta / ANGLE_SCALE],
        axis=-1,
    )


def place(parts: Parts, pose: Pose) -> RoundedBox:
    """Parts in the world frame, at their owners' poses."""
    cos, sin = jnp.cos(pose.theta), jnp.sin(pose.theta)

    def of_parts(value: Float[Array, "agents *samples"]) -> Float[Array, "parts *samples"]:
        # A sum over a one-hot row instead of a gather: its transpose needs no scatter.
        return jnp.concatenate([value, jnp.sum(parts.extra_owner * value[None], axis=1)])

    x, y, cos, sin = of_parts(pose.x), of_parts(pose.y), of_parts(cos), of_parts(sin)
    return in_frames(parts, x, y, cos, sin)


def place_outward(parts: Any, placed: RoundedBox) -> RoundedBox:
    """The same boxes, heading from their owners' origins to their centres."""
    length = jnp.sqrt(jnp.where(parts.valid, parts.x**2 + parts.y**2, 1.0))
    cos, sin = parts.x / length, parts.y / length
    return placed._replace(
        cos=placed.cos * cos - placed.sin * sin, sin=placed.sin * cos + placed.cos * sin
    )


def in_frames(
    parts: Any,
    x: Float[Array, "..."],
    y: Float[Array, "..."],
    cos: Float[Array, "..."],
    sin: Float[Array, "..."],
) -> RoundedBox:
    """Parts, given in frames at (x, y) with the headings (cos, sin), in the world."""
    return RoundedBox(
        x + cos * parts.x - sin * parts.y,
        y + sin * parts.x + cos * parts.y,
        cos,
        sin,
        parts.half_x,
        parts.half_y,
        parts.radius,
    )
