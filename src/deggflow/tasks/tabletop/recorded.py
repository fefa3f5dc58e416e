"""The V that a record of a generation states at its end, measured again from poses: exact geometry in float64.

Guidance descends sums over vertices (`hinges.py`), which are at least the paper's V and zero with it. Here they are
found another way: polygons given by their corners, distances to edges, gaps along the edges' normals.
"""

import math

import numpy as np
from jaxtyping import Float

from .condition import SceneCondition
from .library import object_type
from .verdict import BUFFER, Poses

Corners = Float[np.ndarray, "_ 2"]
Grown = tuple[
    Corners, float
]  # one corner or four, counterclockwise, m; and the radius they are grown by, m
CAUGHT = 0.03  # m, of the weight of V of a caught obstacle
_SIGNS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def recorded_violation(condition: SceneCondition, poses: Poses) -> float:
    """V of a scene as guidance has it, m^2."""
    table = np.array([condition.width, condition.depth]) / 2
    bodies = [_bodies(name, pose) for name, pose in zip(condition.objects, poses, strict=True)]
    regions = [
        _regions(condition, name, pose) for name, pose in zip(condition.objects, poses, strict=True)
    ]
    total = math.fsum(_beyond(shape, table) for row in (*bodies, *regions) for shape in row)
    for one, two in _near(poses, [*bodies, *regions]):
        # A separation counts for both objects, an obstructed region for its owner alone.
        total += 2 * math.fsum(_between(a, b) for a in bodies[one] for b in bodies[two])
        for owner, other in ((one, two), (two, one)):
            for body in bodies[other]:
                blocked = [_blocked(region, body) for region in regions[owner]]
                caught = _caught(regions[owner], poses[owner, :2], body) if any(blocked) else 0.0
                total += math.fsum(v + v / (v + CAUGHT**2) * caught for v in blocked)
    return total


def _near(poses: Poses, rows: list[list[Grown]]) -> list[tuple[int, int]]:
    """Pairs of objects that may be closer than the buffer."""
    from scipy.spatial import KDTree  # takes long to import, and generation needs no trees

    centres = np.concatenate([poses[:, :2], poses[:, :2]])
    extent = max(
        float(np.hypot(*(corners - centre).T).max()) + radius
        for row, centre in zip(rows, centres, strict=True)
        for corners, radius in row
    )
    return sorted(KDTree(poses[:, :2]).query_pairs(2 * extent + BUFFER))


def _place(points: Corners, pose: Float[np.ndarray, " 3"]) -> Corners:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def _bodies(name: str, pose: Float[np.ndarray, " 3"]) -> list[Grown]:
    out = []
    for part in object_type(name).primitives:
        half = np.array([part.half_x - part.corner, part.half_y - part.corner])
        signs = _SIGNS if half.any() else _SIGNS[:1]
        out.append((_place(signs * half + [part.x, part.y], pose), part.corner))
    return out


def _regions(condition: SceneCondition, name: str, pose: Float[np.ndarray, " 3"]) -> list[Grown]:
    need, out = condition.affordance(name), []
    for region in object_type(name).regions:
        reach = need.offset_scale * math.hypot(region.x, region.y)
        heading = math.atan2(region.y, region.x) + need.direction
        centre = np.array([[reach * math.cos(heading), reach * math.sin(heading)]])
        out.append((_place(centre, pose), need.radius_scale * region.radius))
    return out


def _hinges(amount: Float[np.ndarray, "..."]) -> float:
    return float(np.sum(np.maximum(amount, 0.0) ** 2))


def _beyond(shape: Grown, table: Float[np.ndarray, " 2"]) -> float:
    corners, radius = shape
    return _hinges(np.abs(corners) + radius + BUFFER - table) / 2


def _between(one: Grown, two: Grown) -> float:
    (a, grown), (b, also) = one, two
    reach = grown + also + BUFFER
    if len(a) == len(b) == 1:
        return _hinges(reach - _distances(a, b)) / 2
    pairs = [(core, points) for core, points in ((a, b), (b, a)) if len(core) > 1]
    near = math.fsum(_hinges(reach - _distances(points, core)) for core, points in pairs)
    along = min(
        _hinges(math.sqrt(0.5) * reach - gaps)
        for core, points in pairs
        for gaps in _gaps(core, points)
    )
    return near / 2 + along


def _edges(core: Corners) -> tuple[Corners, Corners]:
    edge = np.roll(core, -1, axis=0) - core
    length = np.hypot(*edge.T)[:, None]
    return edge, np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.where(length > 0, length, 1.0)


def _gaps(core: Corners, points: Corners) -> Float[np.ndarray, "edges _"]:
    """How far points are beyond the line of each edge."""
    _, normal = _edges(core)
    return normal @ points.T - np.sum(normal * core, axis=1)[:, None]


def _blocked(region: Grown, body: Grown) -> float:
    (centre, radius), (core, grown) = region, body
    away = _distances(centre, core)
    depth = _gaps(core, centre).max(axis=0) if len(core) > 1 else away
    distance = np.where(away > 0, away, np.minimum(depth, 0.0))
    return _hinges(BUFFER + radius + grown - distance) / 2


def _caught(regions: list[Grown], origin: Float[np.ndarray, " 2"], body: Grown) -> float:
    """Of a body on the strip from an object's origin over its regions: the least of its three sides' hinges."""
    centres, core = np.concatenate([centre for centre, _ in regions]), body[0]
    middle = centres.mean(axis=0)
    out = (middle - origin) / np.hypot(*(middle - origin))
    left = np.array([-out[1], out[0]])
    reach = regions[0][1] + body[1] + BUFFER
    edges = (
        (out, 0.0),
        (left, np.max((centres - middle) @ left)),
        (-left, np.max((middle - centres) @ left)),
    )
    sides = (_hinges(half + reach - (core - middle) @ way) for way, half in edges)
    return min(sides) / len(core) / 2


def _distances(points: Corners, core: Corners) -> Float[np.ndarray, " _"]:
    """Of points to a polygon, zero inside, or to a point."""
    if len(core) == 1:
        return np.hypot(*(points - core).T)
    edge, _ = _edges(core)
    away = points[:, None] - core
    along = np.clip(np.sum(away * edge, axis=-1) / np.sum(edge**2, axis=-1), 0.0, 1.0)
    distance = np.hypot(*np.moveaxis(away - along[..., None] * edge, -1, 0)).min(axis=1)
    return np.where((_gaps(core, points) <= 0).all(axis=0), 0.0, distance)
