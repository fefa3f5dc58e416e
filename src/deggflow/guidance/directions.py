"""Effective directions d_{a,i}: what an agent can do about a row without making its other rows worse.

An allocation in proportion to |d_{a,i}|^2 asks nothing of an agent that can do nothing.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .active_set import crossing, dot, largest, project_origin, resolution, square

DELTA = 0.02  # half width of the blend in phi_delta (paper, Task 1)


def phi(eta: Float[Array, "..."], delta: float = DELTA) -> Float[Array, "..."]:
    """phi_delta: eta below -delta, 0 above delta, twice continuously differentiable, at most min(eta, 0).

    Source: paper, proof of prop:c2_feasibility.
    """
    s = jnp.clip(eta / delta, -1.0, 1.0)
    blend = delta * (s - 1) ** 3 * (s + 3) / 16
    return jnp.where(eta <= -delta, eta, blend)


def effective_directions(
    ell: Float[Array, "factors agents inputs"], delta: float = DELTA
) -> Float[Array, "factors agents inputs"]:
    """d_{a,i}: what is left of a row's direction when what works against the agent's other rows is taken out.

    Moving against d_{a,i} brings row a down and lets none of the others rise. Two rows: the paper's
    directions, with phi_delta. More: the projection of ell_{a,i} onto the directions that no other row of
    the agent opposes, which is the paper's with phi = min(eta, 0) where there are two. Exactly zero where rows are
    opposed up to rounding, so that d_{a,i} != 0 says that row a can be met; rows may be of any scale. A row that is not
    finite has no direction, and the others are as if it were not there.

    Source: paper, before eqn:C2_weights; docs/theory.md for more than two.
    """
    if len(ell) < 2:
        return ell
    with jax.default_matmul_precision("highest"):
        return _directions(ell, delta)


def _directions(
    ell: Float[Array, "factors agents inputs"], delta: float
) -> Float[Array, "factors agents inputs"]:
    # By the largest entry first, so that squares neither over- nor underflow.
    most = jax.lax.stop_gradient(largest(ell))
    live = (most >= float(jnp.finfo(ell.dtype).tiny)) & (most < jnp.inf)  # not so for nan
    most = jnp.where(live, most, 1.0)
    near_one = jnp.where(live[..., None], ell, 0.0) / most[..., None]
    length = jnp.sqrt(jnp.where(live, square(near_one), 1.0))
    unit = near_one / length[..., None]
    if len(ell) == 2:
        against = phi(jnp.clip(dot(unit[0], unit[1]), -1.0, 1.0), delta)
        # A factor that an agent can't change leaves the other one as it is: its unit is zero.
        shift = -against[None, :, None] * unit[::-1]
        least = resolution(ell.dtype) ** 2
    else:
        others = jnp.array([[b for b in range(len(ell)) if b != a] for a in range(len(ell))])
        project = jax.vmap(jax.vmap(_unopposed), in_axes=(0, 1))
        shift = project(unit, unit[others].swapaxes(1, 2).swapaxes(0, 1))
        # What is left is known by its square, and the square up to rounding.
        least = 4 * resolution(ell.dtype)
    # What rounding leaves of a direction that should vanish is none.
    there = live & (square(unit + shift) > least)
    return jnp.where(there[..., None], ell + (length * most)[..., None] * shift, 0.0)


def _unopposed(
    direction: Float[Array, " inputs"], others: Float[Array, "others inputs"]
) -> Float[Array, " inputs"]:
    """The way to the nearest point from which no other row points away: `others @ (direction + way) >= 0`."""
    return project_origin(-others, -(others @ direction), crossing(direction.dtype))[0]
