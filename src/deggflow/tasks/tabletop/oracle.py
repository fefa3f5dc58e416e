"""An independent check of claims by Shapely; shares only the object library with the rest of the package."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Float
from shapely import affinity
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from .condition import SceneCondition
from .library import object_type

TOLERANCE = 1e-9  # m, rounding of float64 arithmetic on lengths of order one

Grown = tuple[BaseGeometry, float]  # a core and the radius it is grown by, m


def _move(core: BaseGeometry, pose: Float[np.ndarray, " 3"]) -> BaseGeometry:
    x, y, theta = pose
    shape = affinity.rotate(core, theta, origin=(0, 0), use_radians=True)
    return affinity.translate(shape, x, y)


def _body(name: str) -> list[Grown]:
    out: list[Grown] = []
    for part in object_type(name).primitives:
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
    for region in object_type(name).regions:
        reach = need.offset_scale * math.hypot(region.x, region.y)
        heading = math.atan2(region.y, region.x) + need.direction
        centre = Point(reach * math.cos(heading), reach * math.sin(heading))
        out.append((centre, need.radius_scale * region.radius))
    return out


def _on_table(condition: SceneCondition, shapes: Sequence[Grown]) -> float:
    bounds = shapely.bounds([core for core, _ in shapes])
    radius = np.array([grown for _, grown in shapes])
    half = np.array([condition.width, condition.depth]) / 2
    return float(np.min(half - np.abs(bounds.reshape(-1, 2, 2)).max(axis=1) - radius[:, None]))


def _least_gap(
    these: Sequence[Sequence[Grown]], others: Sequence[Sequence[Grown]], beyond: float
) -> float:
    """Least distance in m between shapes of different objects if it is at most `beyond`, otherwise infinity."""
    one = [(k, *shape) for k, row in enumerate(these) for shape in row]
    two = [(k, *shape) for k, row in enumerate(others) for shape in row]
    owner, core, radius = (np.array(column) for column in zip(*one, strict=True))
    whose, body, thickness = (np.array(column) for column in zip(*two, strict=True))
    reach = radius + thickness.max() + beyond
    first, second = shapely.STRtree(body).query(core, predicate="dwithin", distance=reach)
    apart = owner[first] != whose[second]
    first, second = first[apart], second[apart]
    gap = shapely.distance(core[first], body[second]) - radius[first] - thickness[second]
    return float(np.min(gap, initial=np.inf))


def least_margin(condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]) -> float:
    """Least margin of a scene in m by Shapely's distances; where cores overlap, only its sign is meaningful."""
    bodies = [
        [(_move(core, pose), grown) for core, grown in _body(name)]
        for name, pose in zip(condition.objects, poses, strict=True)
    ]
    regions = [
        [(_move(core, pose), grown) for core, grown in _regions(condition, name)]
        for name, pose in zip(condition.objects, poses, strict=True)
    ]
    margin = _on_table(condition, [shape for row in (*bodies, *regions) for shape in row])
    # Shapes farther apart than the least margin so far cannot have the least one.
    margin = min(margin, _least_gap(bodies, bodies, max(margin, 0.0)))
    margin = min(margin, _least_gap(regions, bodies, max(margin, 0.0)))
    if condition.balance is not None:
        masses = [object_type(name).mass for name in condition.objects]
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
