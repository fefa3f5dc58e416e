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


class _Choice(NamedTuple):
    """The present choice of each robot.

    Attributes:
        chosen: Its candidate.
        met: What each candidate of each robot adds to V together with another robot's choice; zero while that has none.
        turn: Number of turns that are over; robots take turns in their order.
    """

    chosen: Int[Array, " agents"]
    met: Float[Array, "others agents candidates"]
    turn: Int[Array, ""]


def choose(
    own: Float[Array, "agents candidates"],
    paths: Float[Array, "agents candidates 64 2"],
    reach: Scalar,
    mask: Bool[Array, " agents"],
) -> Int[Array, " agents"]:
    """A candidate of each robot: one after the other, then best responses.

    In turn, each robot takes the candidate with the least cost against the present choices of the others. The sum of all
    costs falls with every change, as the cost of a pair counts for both. Turns in which nothing changes take no time.

    Args:
        own: What each candidate costs without the others.
        paths: Of the candidates, in map units.
        reach: Distance of centres from which on two robots cost nothing.
        mask: Which robots are present.
    """
    count = len(own)
    robots, (x, y) = jnp.arange(count), (paths[..., 0], paths[..., 1])

    def best(state: _Choice) -> Int[Array, " agents"]:
        return jnp.argmin(own + jnp.sum(state.met, axis=0), axis=1).astype(jnp.int32)

    def take(state: _Choice, robot: Int[Array, ""], turn: Int[Array, ""]) -> _Choice:
        choice = best(state)[robot]
        dx, dy = (each - each[robot, choice][None, None] for each in (x, y))
        away = jnp.sqrt(dx**2 + dy**2)
        cost = jnp.sum(jnp.maximum(reach - away, 0.0) ** 2, axis=-1) / BUFFER**2
        counts = mask[robot] & (robots != robot)
        return _Choice(
            state.chosen.at[robot].set(choice),
            state.met.at[robot].set(jnp.where(counts[:, None], cost, 0.0)),
            turn + 1,
        )

    def next_change(state: _Choice) -> Int[Array, ""]:
        """The next turn in which a robot changes its choice; one that never comes if none does."""
        turn = state.turn + (robots - state.turn) % count
        changes = mask & (best(state) != state.chosen)
        return jnp.min(jnp.where(changes, turn, (SWEEPS + 1) * count))

    nobody = _Choice(
        jnp.zeros(count, jnp.int32),
        jnp.zeros((count, *own.shape), own.dtype),
        jnp.zeros((), jnp.int32),
    )
    placed = jax.lax.fori_loop(0, count, lambda k, state: take(state, k, k), nobody)
    settled = jax.lax.while_loop(
        lambda state: next_change(state) < (SWEEPS + 1) * count,
        lambda state: take(state, next_change(state) % count, next_change(state)),
        placed,
    )
    return settled.chosen


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
