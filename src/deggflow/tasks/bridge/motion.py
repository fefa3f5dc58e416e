"""Rigid motions in the plane: poses [x, y, theta], body twists [v_x, v_y, omega], exactly integrated."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def rotate(angle: Float[Array, "..."], v: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """Vectors turned by an angle (rad), counter-clockwise."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([cos * v[..., 0] - sin * v[..., 1], sin * v[..., 0] + cos * v[..., 1]], -1)


def _sinc(angle: Float[Array, "..."]) -> Float[Array, "..."]:
    """sin(a) / a, with finite gradients at zero."""
    small = jnp.abs(angle) < 1e-3
    safe = jnp.where(small, 1.0, angle)
    return jnp.where(small, 1 - angle**2 / 6, jnp.sin(safe) / safe)


def displacement(twist: Float[Array, "... 3"], dt: float) -> Float[Array, "... 3"]:
    """Exponential of SE(2): motion in the body frame after `dt` seconds of a constant twist."""
    turn = dt * twist[..., 2]
    along, across = _sinc(turn), jnp.sin(turn / 2) * _sinc(turn / 2)  # sin a / a, (1 - cos a) / a
    vx, vy = dt * twist[..., 0], dt * twist[..., 1]
    return jnp.stack([along * vx - across * vy, across * vx + along * vy, turn], -1)


def integrate(
    pose: Float[Array, " 3"], twists: Float[Array, "actions 3"], dt: float
) -> Float[Array, "actions 3"]:
    """Poses after each action of a sequence of body twists."""
    steps = displacement(twists, dt)
    after = pose[2] + jnp.cumsum(steps[:, 2])
    place = pose[None, :2] + jnp.cumsum(rotate(after - steps[:, 2], steps[:, :2]), axis=0)
    return jnp.concatenate([place, after[:, None]], axis=-1)


def contact_velocity(
    twist: Float[Array, "... 3"], r: Float[Array, "... 2"]
) -> Float[Array, "... 2"]:
    """J_B(r) twist: velocity, in the plank's frame, of its point r (m)."""
    return jnp.stack(
        [twist[..., 0] - r[..., 1] * twist[..., 2], twist[..., 1] + r[..., 0] * twist[..., 2]], -1
    )


def contact_jacobian(r: Float[Array, "agents 2"]) -> Float[Array, "agents 2 3"]:
    """J_B(r_i) = [I_2, r_i^perp] of every robot (paper, App. on Task 1)."""
    one, zero = jnp.ones_like(r[:, 0]), jnp.zeros_like(r[:, 0])
    return jnp.stack(
        [jnp.stack([one, zero, -r[:, 1]], -1), jnp.stack([zero, one, r[:, 0]], -1)], axis=1
    )
