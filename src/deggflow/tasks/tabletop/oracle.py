"""A second opinion on claims, by Shapely: shares only the object library with the rest of the package."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Float
from shapely import affinity
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from .condition import SceneCondition
from .library import BY_NAME

TOLERANCE = 1e-9  # m, rounding of float64 arithmetic on lengths of order one

Grown = tuple[BaseGeometry, float]  # a core and the radius it is grown by, m


def _move(core: BaseGeometry, pose: Float[np.ndarray, " 3"]) -> BaseGeometry:
    x, y, theta = pose
    turned = affinity.rotate(core, theta, origin=(0, 0), use_radians=True)
    return affinity.translate(turned, x, y)


def _body(name: str) -> list[Grown]:
    out: list[Grown] = []
    for part in BY_NAME[name].primitives:
        width, height = part.half_x - part.corner, part.half_y - part.corner
        if width > 0 and height > 0:
            core = box(part.x - width, part.y - height, part.x + width, part.y + height)
        else:
            core = Point(part.x, part.y)
        out.append((core, part.corner))
    return out


def _regions(condition: SceneCondition, name: str) -> list[Grown]:
    need = condition.affordance(name)
    out: list[Grown] = []
    for region in BY_NAME[name].regions:
        reach = need.offset_scale * math.hypot(region.x, region.y)
        heading = math.atan2(region.y, region.x) + need.direction
        centre = Point(reach * math.cos(heading), reach * math.sin(heading))
        out.append((centre, need.radius_scale * region.radius))
    return out


def _on_table(condition: SceneCondition, placed: Sequence[Grown]) -> float:
    bounds = shapely.bounds([core for core, _ in placed])
    radius = np.array([grown for _, grown in placed])
    half = np.array([condition.width, condition.depth]) / 2
    return float(np.min(half - np.abs(bounds.reshape(-1, 2, 2)).max(axis=1) - radius[:, None]))


def least_margin(condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]) -> float:
    """Least margin of a scene in m by Shapely's distances; where cores overlap, only its sign means anything."""
    bodies = [
        [(_move(core, pose), grown) for core, grown in _body(name)]
        for name, pose in zip(condition.objects, poses, strict=True)
    ]
    regions = [
        [(_move(core, pose), grown) for core, grown in _regions(condition, name)]
        for name, pose in zip(condition.objects, poses, strict=True)
    ]
    pairs = []
    for i in range(len(bodies)):
        for j in range(len(bodies)):
            if i < j:
                pairs += [(a, b) for a in bodies[i] for b in bodies[j]]
            if i != j:
                pairs += [(a, b) for a in regions[i] for b in bodies[j]]
    margin = _on_table(condition, [shape for row in (*bodies, *regions) for shape in row])
    if pairs:
        cores = np.array([[a[0], b[0]] for a, b in pairs], object)
        radii = np.array([a[1] + b[1] for a, b in pairs])
        margin = min(margin, float(np.min(shapely.distance(cores[:, 0], cores[:, 1]) - radii)))
    if condition.balance is not None:
        masses = [BY_NAME[name].mass for name in condition.objects]
        total = math.fsum(masses)
        x, y = (
            math.fsum(m * float(p[k]) for m, p in zip(masses, poses, strict=True)) / total
            for k in range(2)
        )
        away = math.dist((x, y), (condition.balance.x, condition.balance.y))
        margin = min(margin, condition.balance.radius - away)
    return margin


def refutes(condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]) -> bool:
    """Whether the claim that all requirements hold is false."""
    return not least_margin(condition, poses) >= -TOLERANCE
