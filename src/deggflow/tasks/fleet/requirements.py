"""What plans must satisfy, as guidance sees it, and the inputs by which guidance moves paths."""

from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow import requirements as req
from deggflow.guidance import DecoupledGuidance, PrivateRequirement
from deggflow.shapes import Scalar, States

from .condition import APART, FleetArrays
from .obstacles import Obstacles
from .paths import BASIS, MODES, SCALES, WAYPOINTS

BUFFER = 0.01  # map units
LAYOUT = req.Layout(
    axes=2,
    waypoints=WAYPOINTS,
    start="start",
    goal="goal",
    unit="map units",
    modes=BASIS * SCALES,
)
FREE = (0.4, 0.9)  # tau between which inputs turn from smooth modes to single waypoints


def _half_distance(condition: FleetArrays) -> Any:
    return APART / 2 * condition.radius


def _bounds(condition: FleetArrays) -> req.Box:
    low, high = condition.bounds[:2], condition.bounds[2:]
    return req.Box((low + high)[None] / 2, (high - low)[None])


class _Solids(eqx.Module):
    """Boxes and discs of a condition; equal ones share compiled programs."""

    nearest: int = eqx.field(static=True)
    few_discs: bool = eqx.field(static=True)

    def __call__(self, condition: FleetArrays) -> Obstacles:
        solid = condition.solids
        return Obstacles(solid[:, :2], solid[:, 2:4], solid[:, 4], self.nearest, self.few_discs)


def _polygons(condition: FleetArrays) -> req.Polygons:
    return req.Polygons(condition.triangles)


class Crowding(eqx.Module):
    """Which obstacles a compiled program has to look at.

    Attributes:
        nearest: Boxes and discs that one step of a robot can be within reach of at once; 0: there are none.
        polygons: Whether there are polygons.
        few_discs: Whether all of the others are discs, and few.
    """

    nearest: int = eqx.field(static=True)
    polygons: bool = eqx.field(static=True)
    few_discs: bool = eqx.field(static=True, default=False)


def plan_requirement(crowding: Crowding, buffer: float = BUFFER) -> PrivateRequirement:
    """All that a plan must satisfy, as one requirement with one V."""
    plan = (
        req.apart(radius=_half_distance, layout=LAYOUT, buffer=buffer)
        + req.inside(_bounds, radius="radius", layout=LAYOUT, buffer=buffer)
        + req.speed("speed_limit", layout=LAYOUT, buffer=buffer)
    )
    if crowding.nearest:
        solids = _Solids(crowding.nearest, crowding.few_discs)
        plan += req.outside(solids, radius="radius", layout=LAYOUT, buffer=buffer)
    if crowding.polygons:
        polygons = req.outside(
            _polygons, radius="radius", layout=LAYOUT, buffer=buffer, name="outside polygons"
        )
        plan += polygons
    return plan


class CoarseToFine(eqx.Module):
    """A control map g(tau) that moves smooth modes of a path first, and every waypoint alike at the end.

    An input moves mode k of a path by its prior standard deviation at first. From `free[0]` to `free[1]` the weights
    turn to one number for all modes, which is to say that every waypoint can be moved alone. g(tau) has full rank
    throughout, as no weight is ever zero.

    Attributes:
        free: (tau, tau) between which the weights change.
    """

    free: tuple[float, float] = eqx.field(static=True, default=FREE)

    def __call__(
        self, tau: Scalar, z: States, condition: FleetArrays
    ) -> Float[Array, "agents dim"]:
        """The diagonal of g."""
        smooth = np.repeat(SCALES / SCALES[0], z.shape[1] // MODES)
        first, last = self.free
        s = jnp.clip((tau - first) / (last - first), 0.0, 1.0)
        share = s * s * (3 - 2 * s)
        path = smooth + (1 - smooth) * share  # of each mode of a path, per input
        weights = path / jnp.asarray(smooth * SCALES[0], z.dtype)
        return jnp.broadcast_to(weights.astype(z.dtype), z.shape)


@cache
def fleet_guidance(crowding: Crowding) -> DecoupledGuidance:
    """The guidance of the commands."""
    return DecoupledGuidance((plan_requirement(crowding),), control=CoarseToFine())
