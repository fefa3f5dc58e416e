"""Each robot's path out of several nominal ones, by best responses: which corridor, which side, who goes first."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from deggflow.guidance.sums import SumOfMargins
from deggflow.shapes import States

from .condition import APART, FleetArrays
from .paths import WAYPOINTS, to_path
from .requirements import BUFFER, Crowding, plan_requirement

SWEEPS = 4

Candidates = Float[Array, "candidates agents dim"]


def own_costs(
    candidates: Candidates, condition: FleetArrays, crowding: Crowding
) -> Float[Array, "agents candidates"]:
    """V_j of each candidate on its own: obstacles, bounds and the speed limit."""
    margins = plan_requirement(crowding).margins
    assert isinstance(margins, SumOfMargins)
    terms = [term for term, own in zip(margins.parts, _own(crowding), strict=True) if own]

    def one(z: States) -> Float[Array, " agents"]:
        values = [term.violation(z, condition, BUFFER) for term in terms]
        return sum(values[1:], values[0]) / BUFFER**2

    return jax.vmap(one)(candidates).T


def _own(crowding: Crowding) -> list[bool]:
    """Which parts of the requirement are of each robot alone."""
    return [False, True, True, *[True] * (bool(crowding.nearest) + crowding.polygons)]


def pair_costs(
    candidates: Candidates, condition: FleetArrays
) -> Float[Array, "agents candidates agents candidates"]:
    """What two candidates add to V together, at waypoints; zero between those of one robot."""
    count, agents, _ = candidates.shape
    paths = jax.vmap(lambda z: to_path(z, condition.start, condition.goal))(candidates)
    # About the middle of the floor, so that squares are small.
    middle = (condition.bounds[:2] + condition.bounds[2:]) / 2
    flat = jnp.moveaxis(paths - middle[None, None, None], 0, 1).reshape(
        agents * count, WAYPOINTS, 2
    )
    reach = APART * condition.radius + BUFFER

    def at(total: Float[Array, "one other"], x: Float[Array, "one 2"]) -> tuple[Array, None]:
        offset_x, offset_y = (x[:, None, k] - x[None, :, k] for k in range(2))
        near = jnp.sqrt(offset_x**2 + offset_y**2)
        return total + jnp.maximum(reach - near, 0.0) ** 2, None

    total, _ = jax.lax.scan(
        at, jnp.zeros((len(flat), len(flat)), flat.dtype), jnp.moveaxis(flat, 1, 0)
    )
    table = total.reshape(agents, count, agents, count) / BUFFER**2
    apart = ~jnp.eye(agents, dtype=bool) & condition.mask[:, None] & condition.mask[None]
    return jnp.where(apart[:, None, :, None], table, 0.0)


def choose(
    own: Float[Array, "agents candidates"],
    pairs: Float[Array, "agents candidates agents candidates"],
) -> Int[Array, " agents"]:
    """A candidate of each robot: one after the other, then best responses.

    In turn, each robot takes the candidate with the least cost against the present choices of the others. The sum of all
    costs falls with every change, as the cost of a pair counts for both.
    """
    agents = own.shape[0]

    def respond(k: Int[Array, ""], state: tuple[Array, Array]) -> tuple[Array, Array]:
        chosen, placed = state
        robot = k % agents
        costs = jnp.take_along_axis(pairs[robot], chosen[None, :, None], axis=2)[..., 0]
        cost = own[robot] + jnp.sum(jnp.where(placed[None], costs, 0.0), axis=1)
        return chosen.at[robot].set(jnp.argmin(cost)), placed.at[robot].set(True)

    none = jnp.zeros(agents, jnp.int32), jnp.zeros(agents, bool)
    return jax.lax.fori_loop(0, (SWEEPS + 1) * agents, respond, none)[0]


def best_response(
    candidates: Candidates,
    condition: FleetArrays,
    crowding: Crowding,
    handicaps: Float[Array, "candidates agents"],
) -> States:
    """One path of each robot, out of its candidates, whose own costs have a handicap each.

    A robot must know the present choice of every other robot, and its own candidates.
    """
    own = own_costs(candidates, condition, crowding) + handicaps.T
    chosen = choose(own, pair_costs(candidates, condition))
    return jnp.take_along_axis(candidates, chosen[None, :, None], axis=0)[0]
