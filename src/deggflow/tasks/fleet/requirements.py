"""What plans must satisfy, as guidance sees it, and the inputs that guidance moves paths by."""

from functools import partial
from typing import Any

import jax.numpy as jnp

from deggflow import requirements as req
from deggflow.guidance import PrivateRequirement

from .condition import APART, FleetArrays
from .obstacles import Obstacles
from .paths import BASIS, SCALES, WAYPOINTS

BUFFER = 0.01  # map units
LAYOUT = req.Layout(
    axes=2,
    waypoints=WAYPOINTS,
    start="start",
    goal="goal",
    unit="map units",
    modes=BASIS * SCALES,
)


def _half_distance(condition: FleetArrays) -> Any:
    return APART / 2 * condition.radius


def _bounds(condition: FleetArrays) -> req.Box:
    low, high = condition.bounds[:2], condition.bounds[2:]
    return req.Box((low + high)[None] / 2, (high - low)[None])


def _obstacles(condition: FleetArrays, nearest: int) -> Any:
    solid = condition.solids
    known = Obstacles(solid[:, :2], solid[:, 2:4], solid[:, 4], nearest)
    return known


def plan_requirement(nearest: int, buffer: float = BUFFER) -> PrivateRequirement:
    """All that a plan must satisfy, as one requirement with one V; `nearest`: of `Obstacles`, 0: none."""
    plan = (
        req.apart(radius=_half_distance, layout=LAYOUT, buffer=buffer)
        + req.inside(_bounds, radius="radius", layout=LAYOUT, buffer=buffer)
        + req.speed("speed_limit", layout=LAYOUT, buffer=buffer)
    )
    if nearest:
        plan += req.outside(
            partial(_obstacles, nearest=nearest), radius="radius", layout=LAYOUT, buffer=buffer
        )
    return plan
