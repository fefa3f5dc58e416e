"""Which parts of a picture a verdict marks."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.verdict import Kind, Verdict


class Marks(NamedTuple):
    """What is drawn in red; everything else is free.

    Attributes:
        blocked: (owner, region) of regions obstructed or over the edge.
        outlined: Objects that overlap another one or reach over the edge.
        unbalanced: Whether the centre of mass lies outside its circle.
    """

    blocked: frozenset[tuple[int, int]]
    outlined: frozenset[int]
    unbalanced: bool = False


class Disc(NamedTuple):
    """One affordance region as its user requires it, in the owner's body frame.

    Attributes:
        x: Of its centre, m.
        y: Of its centre, m.
        radius: m.
    """

    x: float
    y: float
    radius: float


def marks_of(verdict: Verdict) -> Marks:
    """The marks of one verdict. Who obstructs a region is not marked, the region is."""
    blocked, outlined = set(), set()
    for breach in verdict.breaches:
        if breach.kind in (Kind.UNOBSTRUCTED, Kind.REGION_ON_TABLE):
            blocked.add((breach.owner, breach.region))
        elif breach.owner >= 0:
            outlined.add(breach.owner)
            if breach.kind is Kind.SEPARATION:
                outlined.add(breach.other)
    unbalanced = any(breach.kind is Kind.BALANCE for breach in verdict.breaches)
    return Marks(frozenset(blocked), frozenset(outlined), unbalanced)


def centre_of_mass(
    condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]
) -> Float[np.ndarray, " 2"]:
    """Where the objects' common centre of mass lies, m."""
    mass = np.array([object_type(name).mass for name in condition.objects])
    return np.asarray(mass @ poses[:, :2] / mass.sum())


def discs_of(condition: SceneCondition, name: str) -> list[Disc]:
    """The affordance regions of one object under the condition's requirements."""
    need = condition.affordance(name)
    cos, sin = np.cos(need.direction), np.sin(need.direction)
    discs = []
    for region in object_type(name).regions:
        x, y = need.offset_scale * region.x, need.offset_scale * region.y
        radius = need.radius_scale * region.radius
        discs.append(Disc(float(cos * x - sin * y), float(sin * x + cos * y), radius))
    return discs


def checked_poses(
    condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]
) -> Float[np.ndarray, "agents 3"]:
    """The poses in float64, one row per object.

    Raises:
        ValueError: If the number of rows is another, or a number is not finite.
    """
    rows = np.asarray(poses, np.float64)
    if rows.shape != (len(condition.objects), 3):
        raise ValueError(
            f"`poses` must hold x, y, theta of each of the condition's {len(condition.objects)} "
            f"objects; got shape {rows.shape}."
        )
    if not np.isfinite(rows).all():
        raise ValueError("`poses` must be finite: an object at nan or inf cannot be drawn.")
    return rows
