"""Compiled programs: nominal plans of each robot, a choice among them, and guidance."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.drift import EVERY_STEP, AbstractDrift, AfterPrediction
from deggflow.flow import Field
from deggflow.generation import Generation
from deggflow.guidance import AbstractGuidance
from deggflow.sampler import Grid, masked_batch
from deggflow.shapes import Scalar, States
from deggflow.step_guard import StepGuard

from .condition import FleetArrays
from .modes import OWN, best_response, own_costs
from .paths import modes_of, to_path
from .requirements import Crowding
from .timing import timed

Noise = Float[Array, "samples candidates agents dim"]


class Draw(NamedTuple):
    """What one draw of some plans starts from.

    Attributes:
        arrays: Conditions.
        kept: States of robots that keep their path from the draw before.
        keeps: Which robots do.
        routes: Short ways of each robot on its own roadmap, candidates beside the field's paths.
        handicap: Added to the cost of these candidates: how much more the field's own paths may cost.
    """

    arrays: FleetArrays
    kept: States
    keeps: Bool[Array, " agents"]
    routes: Float[Array, "routes agents dim"]
    handicap: Float[Array, " agents"]

    @property
    def mask(self) -> Bool[Array, " agents"]:
        """Which robots are present."""
        return self.arrays.mask


def still(tau: Scalar, z: States, condition: Any) -> States:
    """A field that moves nothing: guidance acts on a nominal sample, and V changes by inputs alone."""
    return jnp.zeros_like(z)


def predictions(
    field: Field, drift: AbstractDrift, noise: Float[Array, "candidates agents dim"], draw: Draw
) -> Float[Array, "candidates agents dim"]:
    """Nominal plans of one condition."""

    def one(z0: States) -> States:
        return AfterPrediction(drift).start(lambda tau, z: field(tau, z, draw.arrays), z0)

    return jax.vmap(one)(noise)


def chosen_of(
    candidates: Float[Array, "candidates agents dim"],
    costs: Float[Array, "candidates agents"],
    draw: Draw,
) -> States:
    """The path of each robot out of its candidates at all timings; a robot that keeps its path has no others."""
    start, goal = draw.arrays.start, draw.arrays.goal
    plain = jax.vmap(lambda z: to_path(z, start, goal))(candidates)
    paths = timed(plain, draw.arrays)
    paths = jnp.where(draw.keeps[None, None, :, None, None], plain[None], paths)
    costs = jnp.tile(costs, (len(paths), 1))
    chosen = best_response(paths.reshape(-1, *plain.shape[1:]), costs.T, draw.arrays)
    timing, candidate = jnp.divmod(chosen, len(candidates))
    robots = jnp.arange(len(chosen))
    as_it_is = (timing == 0) | draw.keeps
    other = modes_of(paths[timing, candidate, robots], start, goal)
    return jnp.where(as_it_is[:, None], candidates[candidate, robots], other)


class ChosenThenGuided:
    """A program for `Sampler`: nominal plans and routes, each robot's choice of path and timing, guidance from there."""

    def __init__(self, crowding: Crowding) -> None:
        """Args: crowding: of the conditions."""
        self.crowding = crowding

    def __call__(
        self,
        field: Field,
        guidance: AbstractGuidance,
        noise: Noise,
        draws: Draw,
        grid: Grid,
        drift: AbstractDrift,
        guard: StepGuard | None,
        keep_trace: bool,
    ) -> Generation:
        """Args: as of `masked_batch`, with noise of several nominal plans and `Draw`s as conditions."""

        def start(noise: Float[Array, "candidates agents dim"], draw: Draw) -> States:
            nominal = predictions(field, drift, noise, draw)
            plain = jnp.concatenate([nominal, draw.routes])
            plain = jnp.where(draw.keeps[None, :, None], draw.kept[None], plain)
            # Timings change what a robot violates alone but little: they keep to its way and its speed limit.
            costs = OWN * own_costs(plain, draw.arrays, self.crowding)
            costs = costs.T.at[len(nominal) :].add(draw.handicap[None])
            return chosen_of(plain, costs, draw)

        z0 = jax.vmap(start)(noise, draws)
        return masked_batch(still, guidance, z0, draws.arrays, grid, EVERY_STEP, guard, keep_trace)


def guided_throughout(
    field: Field, guidance: AbstractGuidance, noise: Noise, draws: Draw, *how: Any
) -> Generation:
    """A program for `Sampler`: the generation from the first z(0), guided or nominal."""
    return masked_batch(field, guidance, noise[:, 0], draws.arrays, *how)
