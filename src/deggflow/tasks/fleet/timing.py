"""Who goes first: the same ways at other times. A robot waits at its start or arrives early, within its speed limit."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .condition import FleetArrays
from .paths import WAYPOINTS

SHIFTS = (0.0, 0.2, -0.2, 0.4, -0.4)  # shares of the time spent waiting, if negative at the goal
PACE = 0.8  # largest share of the speed limit: guidance needs the rest


def timed(
    paths: Float[Array, "candidates agents 64 2"], condition: FleetArrays
) -> Float[Array, "timings candidates agents 64 2"]:
    """Each path as it is, then with each of the other `SHIFTS`, or as much of it as its pace allows.

    Where a path leaves no room to wait, its timings are those of the path itself. A robot must know its own paths only.
    """
    step = jnp.sqrt(jnp.max(jnp.sum(jnp.diff(paths, axis=2) ** 2, axis=-1), axis=-1))
    room = jnp.maximum(1 - step / (PACE * condition.speed_limit), 0.0)[..., None]
    waypoint = jnp.arange(WAYPOINTS)
    t = waypoint[None, None] / (WAYPOINTS - 1)

    def shifted(shift: float) -> Float[Array, "candidates agents 64 2"]:
        wait = jnp.minimum(room, abs(shift))
        late = jnp.maximum(t - wait, 0.0) / (1 - wait)
        early = jnp.minimum(t / (1 - wait), 1.0)
        place = (late if shift > 0 else early) * (WAYPOINTS - 1)
        # As a product with a matrix of weights: XLA's CPU backend gathers more slowly.
        hat = jnp.maximum(1 - jnp.abs(place[..., None] - waypoint[None, None, None]), 0.0)
        return hat @ paths

    return jnp.stack([paths, *(shifted(shift) for shift in SHIFTS[1:])])
