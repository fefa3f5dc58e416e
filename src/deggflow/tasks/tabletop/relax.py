"""Random arrangements relaxed until their default requirements hold: the demonstrations of Task 2."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from deggflow.shapes import Scalar

from .codec import ANGLE_SCALE
from .condition import TabletopCondition
from .geometry import larger
from .margins import least_margin, scene_margins

LEVER_ARM = (
    0.1  # m, converts between radians and metres, as positions and headings share one step size
)
STEP = 0.2  # of the preconditioned gradient
STEPS = 600


def random_states(key: PRNGKeyArray, condition: TabletopCondition) -> Float[Array, "agents 3"]:
    """Positions uniform on the table, headings uniform on the circle."""
    unit = jax.random.uniform(key, (*condition.mask.shape, 3), minval=-1.0, maxval=1.0)
    return unit * jnp.array([[1.0, 1.0, jnp.pi / ANGLE_SCALE]])


def relax(
    z: Float[Array, "agents 3"], condition: TabletopCondition, clearance: float
) -> Float[Array, "agents 3"]:
    """Gradient steps on half the squared hinges of all margins with a buffer of `clearance` m, one scene."""
    scale = jnp.stack(
        [condition.half_width, condition.half_depth, jnp.asarray(ANGLE_SCALE * LEVER_ARM)]
    )

    def violation(state: Float[Array, "agents 3"]) -> Scalar:
        margins = scene_margins(state, condition)
        hinges = [jnp.sum(larger(clearance - margin, 0.0) ** 2) / 2 for margin in margins]
        return hinges[0] + sum(hinges)  # a separation counts for both objects

    gradient = jax.grad(violation)

    def step(_: Int[Array, ""], state: Float[Array, "agents 3"]) -> Float[Array, "agents 3"]:
        return state - STEP * gradient(state) / scale[None] ** 2

    return jax.lax.fori_loop(0, STEPS, step, z)


@partial(jax.jit, static_argnames="clearance")
def relaxed_scenes(
    keys: Key[Array, " scenes"], conditions: TabletopCondition, clearance: float
) -> tuple[Float[Array, "scenes agents 3"], Float[Array, " scenes"]]:
    """Relaxed states of a batch of conditions, one key each, and the least margin of each in m."""

    def one(
        key: PRNGKeyArray, condition: TabletopCondition
    ) -> tuple[Float[Array, "agents 3"], Scalar]:
        z = relax(random_states(key, condition), condition, clearance)
        return z, least_margin(z, condition)

    return jax.vmap(one)(keys, conditions)
