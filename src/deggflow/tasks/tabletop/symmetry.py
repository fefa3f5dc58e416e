"""Symmetries of the table: rotation by pi and mirroring map valid scenes to valid scenes.

Every object of the library is its own mirror image about its x axis (affordance regions in front, on the
x axis) or about its y axis (regions on the -y side), so a mirrored scene is a scene of the same objects.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .codec import Pose, decode, encode
from .condition import TabletopCondition
from .library import LIBRARY

# Mirroring y -> -y turns the heading theta into MIRROR_OFFSET - theta.
MIRROR_OFFSET = np.array([0.0 if kind.regions[0].y == 0.0 else np.pi for kind in LIBRARY])


def wrap(angle: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle in [-pi, pi)."""
    return jnp.mod(angle + jnp.pi, 2 * jnp.pi) - jnp.pi


def mirror(pose: Pose, condition: TabletopCondition) -> Pose:
    """The scene mirrored in the table's x axis."""
    offset = jnp.asarray(MIRROR_OFFSET, pose.theta.dtype)[condition.kind]
    return Pose(pose.x, -pose.y, wrap(offset - pose.theta))


def half_turn(pose: Pose) -> Pose:
    """The scene rotated by pi about the table's centre."""
    return Pose(-pose.x, -pose.y, wrap(pose.theta + jnp.pi))


def random_symmetry(
    key: PRNGKeyArray, z: Float[Array, "agents 3"], condition: TabletopCondition
) -> Float[Array, "agents 3"]:
    """One of the four symmetries, drawn uniformly, applied to encoded data."""
    flip, turn = jax.random.bernoulli(key, shape=(2,))
    pose = decode(z, condition)
    pose = jax.tree.map(lambda a, b: jnp.where(flip, a, b), mirror(pose, condition), pose)
    pose = jax.tree.map(lambda a, b: jnp.where(turn, a, b), half_turn(pose), pose)
    return encode(pose, condition)
