"""Who goes first: the same ways at other times. A robot waits at its start or arrives early, within its speed limit."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .condition import FleetArrays
from .paths import BASIS, DIM, SCALES, WAYPOINTS, to_path

SHIFTS = (0.0, 0.2, -0.2, 0.4, -0.4)  # shares of the time spent waiting, if negative at the goal
PACE = 0.8  # largest share of the speed limit: guidance needs the rest

Candidates = Float[Array, "candidates agents dim"]


def timed(
    candidates: Candidates, condition: FleetArrays
) -> Float[Array, "timings candidates agents dim"]:
    """Each candidate as it is, then with each of the other `SHIFTS`, or as much of it as its pace allows.

    Where a path leaves no room to wait, its timings are those of the path itself. A robot must know its own paths only.
    """

    def path_of(z: Float[Array, "agents dim"]) -> Float[Array, "agents 64 2"]:
        return to_path(z, condition.start, condition.goal)

    paths, line = jax.vmap(path_of)(candidates), path_of(jnp.zeros_like(candidates[0]))
    step = jnp.sqrt(jnp.max(jnp.sum(jnp.diff(paths, axis=2) ** 2, axis=-1), axis=-1))
    room = jnp.maximum(1 - step / (PACE * condition.speed_limit), 0.0)[..., None]
    waypoint = jnp.arange(WAYPOINTS)
    t = waypoint[None, None] / (WAYPOINTS - 1)
    weights = jnp.asarray(BASIS.T / np.asarray(SCALES)[:, None], candidates.dtype)

    def shifted(shift: float) -> Candidates:
        wait = jnp.minimum(room, abs(shift))
        late = jnp.maximum(t - wait, 0.0) / (1 - wait)
        early = jnp.minimum(t / (1 - wait), 1.0)
        place = (late if shift > 0 else early) * (WAYPOINTS - 1)
        # As a product with a matrix of weights: XLA's CPU backend gathers more slowly.
        hat = jnp.maximum(1 - jnp.abs(place[..., None] - waypoint[None, None, None]), 0.0)
        moved = hat @ paths - line[None]
        modes = jnp.einsum("mt,catx->camx", weights, moved)
        return modes.reshape(*candidates.shape[:-1], DIM)

    return jnp.stack([candidates, *(shifted(shift) for shift in SHIFTS[1:])])
