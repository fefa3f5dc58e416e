"""A path of each robot out of several, by best responses: which corridor, which side, who goes first."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.guidance.sums import SumOfMargins
from deggflow.shapes import Scalar, States

from .condition import APART, FleetArrays
from .requirements import BUFFER, Crowding, plan_requirement

SWEEPS = 4
OWN = 4.0  # weight of what a robot violates alone: guidance parts two robots more easily than it moves one off an obstacle

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


def meetings(
    paths: Float[Array, "candidates 64 2"], others: Float[Array, "others 64 2"], reach: Scalar
) -> Float[Array, "candidates others"]:
    """What each of some paths and each of others add to V together, at waypoints."""
    x, y = (paths[:, None, :, k] - others[None, :, :, k] for k in (0, 1))
    near = jnp.sqrt(x**2 + y**2)
    return jnp.sum(jnp.maximum(reach - near, 0.0) ** 2, axis=-1) / BUFFER**2


def choose(
    own: Float[Array, "agents candidates"],
    paths: Float[Array, "agents candidates 64 2"],
    reach: Scalar,
    mask: Bool[Array, " agents"],
) -> Int[Array, " agents"]:
    """A candidate of each robot: one after the other, then best responses.

    In turn, each robot takes the candidate with the least cost against the present choices of the others. The sum of all
    costs falls with every change, as the cost of a pair counts for both.

    Args:
        own: What each candidate costs without the others.
        paths: Of the candidates, in map units.
        reach: Distance of centres from which on two robots cost nothing.
        mask: Which robots are present.
    """
    robots = jnp.arange(len(own))

    def respond(k: Int[Array, ""], state: _Choice) -> _Choice:
        robot = k % len(own)
        counts = state.placed & mask & (robots != robot)
        costs = jnp.where(counts[None], meetings(paths[robot], state.paths, reach), 0.0)
        best = jnp.argmin(own[robot] + jnp.sum(costs, axis=1))
        return _Choice(
            state.chosen.at[robot].set(best),
            state.paths.at[robot].set(paths[robot, best]),
            state.placed.at[robot].set(True),
        )

    nobody = _Choice(jnp.zeros(len(own), jnp.int32), paths[:, 0], jnp.zeros(len(own), bool))
    return jax.lax.fori_loop(0, (SWEEPS + 1) * len(own), respond, nobody).chosen


class _Choice(NamedTuple):
    """The present choice of each robot, its path, and whether it has had a turn."""

    chosen: Int[Array, " agents"]
    paths: Float[Array, "agents 64 2"]
    placed: Bool[Array, " agents"]


def best_response(
    paths: Float[Array, "candidates agents 64 2"],
    costs: Float[Array, "agents candidates"],
    condition: FleetArrays,
) -> Int[Array, " agents"]:
    """Number of the path that each robot takes, out of candidates each of which costs so much without the others.

    A robot must know the present choice of every other robot, and its own candidates.
    """
    reach = APART * condition.radius + BUFFER
    return choose(costs, jnp.moveaxis(paths, 0, 1), reach, condition.mask)
