"""Where in a scene a margin is: the line between the two outlines that it is the distance of."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.verdict import Kind, Margin
from deggflow.view.outlines import placed

from .marks import centre_of_mass, discs_of

Spot = tuple[float, float]
"""x and y on the table, m."""


class Gap(NamedTuple):
    """A line whose length is the size of a margin; where shapes overlap, it crosses the overlap.

    Attributes:
        start: On the outline of the requirement's owner, m.
        end: On the other outline, m.
    """

    start: Spot
    end: Spot


class _Grown(NamedTuple):
    """A point or polygon and the radius in m that it is grown by."""

    core: BaseGeometry
    radius: float


def gap_of(condition: SceneCondition, poses: Float[np.ndarray, "agents 3"], margin: Margin) -> Gap:
    """The line that a margin is the length of.

    Args:
        condition: Objects, requirements and table.
        poses: x, y (m) and theta (rad) of each object.
        margin: One of the scene's.
    """
    if margin.kind is Kind.BALANCE:
        return _off_balance(condition, poses)
    own = _shapes(condition, poses, margin.owner, margin.region)
    if margin.other < 0:
        return _to_edge(condition, own)
    return _between(own, _shapes(condition, poses, margin.other, -1))


def _shapes(
    condition: SceneCondition, poses: Float[np.ndarray, "agents 3"], owner: int, region: int
) -> list[_Grown]:
    """The shapes of an object's body, or one of its regions."""
    name, pose = condition.objects[owner], poses[owner]
    if region >= 0:
        disc = discs_of(condition, name)[region]
        return [_Grown(Point(placed(np.array([[disc.x, disc.y]]), pose)[0]), disc.radius)]
    shapes = []
    for part in object_type(name).primitives:
        x, y = part.half_x - part.corner, part.half_y - part.corner
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + [part.x, part.y]
        outline = placed(corners, pose)
        core = (
            Polygon(outline) if min(x, y) > 0 else shapely.convex_hull(shapely.multipoints(outline))
        )
        shapes.append(_Grown(core, part.corner))
    return shapes


def _between(these: list[_Grown], others: list[_Grown]) -> Gap:
    pairs = [(one, other) for one in these for other in others]
    one, other = min(
        pairs,
        key=lambda pair: pair[0].core.distance(pair[1].core) - pair[0].radius - pair[1].radius,
    )
    if one.core.intersects(other.core):
        middle = one.core.intersection(other.core).centroid
        return Gap((middle.x, middle.y), (middle.x, middle.y))
    a, b = shapely.get_coordinates(shapely.shortest_line(one.core, other.core))
    along = (b - a) / math.dist(a, b)
    return Gap(_spot(a + one.radius * along), _spot(b - other.radius * along))


def _to_edge(condition: SceneCondition, shapes: list[_Grown]) -> Gap:
    """From the point that is nearest to the table's edge, or farthest over it, to the edge."""
    half = np.array([condition.width, condition.depth]) / 2
    gaps: list[tuple[float, Gap]] = []
    for core, radius in shapes:
        for corner in shapely.get_coordinates(core):
            for axis in range(2):
                side = 1.0 if corner[axis] >= 0 else -1.0
                start, end = corner.copy(), corner.copy()
                start[axis] += side * radius
                end[axis] = side * half[axis]
                gaps.append((half[axis] - abs(start[axis]), Gap(_spot(start), _spot(end))))
    return min(gaps)[1]


def _off_balance(condition: SceneCondition, poses: Float[np.ndarray, "agents 3"]) -> Gap:
    """From the centre of mass to the nearest point of its circle."""
    circle = condition.balance
    assert circle is not None
    middle, mass = np.array([circle.x, circle.y]), centre_of_mass(condition, poses)
    away = math.dist(mass, middle)
    along = (mass - middle) / away if away > 0 else np.array([1.0, 0.0])
    return Gap(_spot(mass), _spot(middle + circle.radius * along))


def _spot(point: Float[np.ndarray, " 2"]) -> Spot:
    return float(point[0]), float(point[1])
