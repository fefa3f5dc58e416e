"""The verdict on finished scenes: exact geometry in float64, from the object library and poses alone.

Shares no code with the margins that guidance uses: cores are polygons given by their corners, distances
run over corner-edge pairs, penetration over the polygons' own edge normals.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .condition import SceneCondition
from .library import object_type, type_name

BUFFER = 0.02  # m, delta^PE of the reported violation V (paper, Task 2)
_CHUNK = 64  # scenes measured at once: of more, what is computed no longer fits the cache
_FEW = 64  # largest number of shapes of a scene for which all pairs are measured

Poses = Float[np.ndarray, "_ 3"]


class Kind(Enum):
    """The kinds of geometric requirement."""

    SEPARATION = "separation"
    UNOBSTRUCTED = "unobstructed"
    OBJECT_ON_TABLE = "object on table"
    REGION_ON_TABLE = "region on table"
    BALANCE = "balance"


_KINDS = tuple(Kind)


class Margin(NamedTuple):
    """One requirement and how far it is met. `owner` and `other` index the condition's objects."""

    kind: Kind
    owner: int  # -1 if it concerns all objects together
    region: (
        int  # affordance region of the owner; -1 where the requirement is about the object itself
    )
    other: int  # the other object; -1 for the table's edge
    margin: float  # m, negative where the requirement does not hold


Breach = Margin
"""A `Margin` that is negative, or not a number."""


@dataclass(frozen=True)
class Verdict:
    """The verdict of exact geometry on one scene."""

    min_margin: float  # m, the least of all margins
    violation: float  # V with the buffer delta^PE, m^2
    breaches: tuple[Breach, ...]  # the worst first

    @property
    def satisfied(self) -> bool:
        """Whether every requirement holds."""
        return not self.breaches

    def reason(self, objects: Sequence[str]) -> str | None:
        """The worst breach in words and the number of others; None if all requirements hold."""
        if not self.breaches:
            return None
        more = len(self.breaches) - 1
        return describe(self.breaches[0], objects) + (f" (and {more} more)" if more else "")


def describe(breach: Breach, objects: Sequence[str]) -> str:
    """A breach in words. Args: breach: of a scene; objects: the condition's names."""
    owner, depth = objects[breach.owner], f"{-breach.margin:.4f} m"
    other = objects[breach.other]
    match breach.kind:
        case Kind.SEPARATION:
            return f"{owner} and {other} overlap by {depth}"
        case Kind.UNOBSTRUCTED:
            return f"{other} obstructs affordance region {breach.region + 1} of {owner} by {depth}"
        case Kind.OBJECT_ON_TABLE:
            return f"{owner} reaches {depth} over the table's edge"
        case Kind.REGION_ON_TABLE:
            return f"affordance region {breach.region + 1} of {owner} reaches {depth} over the table's edge"
        case Kind.BALANCE:
            return f"the centre of mass lies {depth} outside its circle"


class _Shapes(NamedTuple):
    """Dilated polygons of a batch of scenes in one list."""

    corners: Float[np.ndarray, "shapes 4 2"]  # m, world, counterclockwise
    radius: Float[np.ndarray, " shapes"]
    scene: Int[np.ndarray, " shapes"]
    owner: Int[np.ndarray, " shapes"]
    region: Int[np.ndarray, " shapes"]  # -1 for the object's own shape


class _TypeShapes(NamedTuple):
    """Shapes of one type of object in its body frame: its body's, then its default regions."""

    corners: Float[np.ndarray, "shapes 4 2"]
    radius: Float[np.ndarray, " shapes"]
    region: Int[np.ndarray, " shapes"]


@cache
def _type_shapes(name: str) -> _TypeShapes:
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    parts, regions = object_type(name).primitives, object_type(name).regions
    corners = [signs * [p.half_x - p.corner, p.half_y - p.corner] + [p.x, p.y] for p in parts]
    corners += [np.full((4, 2), [r.x, r.y]) for r in regions]
    radius = [p.corner for p in parts] + [r.radius for r in regions]
    number = [-1] * len(parts) + list(range(len(regions)))
    return _TypeShapes(np.array(corners), np.array(radius), np.array(number))


def _collect(conditions: Sequence[SceneCondition], poses: Sequence[Poses]) -> _Shapes:
    names = [name for condition in conditions for name in condition.objects]
    types = [_type_shapes(type_name(name)) for name in names]
    needs = [c.affordance(name) for c in conditions for name in c.objects]
    counts = [len(condition.objects) for condition in conditions]
    if [len(pose) for pose in poses] != counts:
        raise ValueError("`poses` must have one row for each object of each condition.")
    scene = np.repeat(np.arange(len(conditions)), counts)
    owner = np.concatenate([np.arange(count) for count in counts])
    # From here on, one row for each shape instead of each object.
    thing = np.repeat(np.arange(len(names)), [len(each.radius) for each in types])
    local, radius, region = (np.concatenate(each) for each in zip(*types, strict=True))
    scale, thickness, direction = np.array(
        [(need.offset_scale, need.radius_scale, need.direction) for need in needs], np.float64
    )[thing].T
    regions = region >= 0
    x, y = local[regions, 0].T
    centre = (x + 1j * y) * scale[regions] * np.exp(1j * direction[regions])
    local[regions] = np.stack([centre.real, centre.imag], axis=-1)[:, None]
    radius[regions] *= thickness[regions]
    x, y, theta = np.concatenate(poses).astype(np.float64)[thing].T[..., None]
    cos, sin = np.cos(theta), np.sin(theta)
    world = np.stack(
        [
            x + cos * local[..., 0] - sin * local[..., 1],
            y + sin * local[..., 0] + cos * local[..., 1],
        ],
        axis=-1,
    )
    return _Shapes(world, radius, scene[thing], owner[thing], region)


def _corner_to_edge(
    points: Float[np.ndarray, "pairs points 2"], polygon: Float[np.ndarray, "pairs 4 2"]
) -> Float[np.ndarray, " pairs"]:
    """Least distance from the points to the edges of the polygon."""
    edges = np.roll(polygon, -1, axis=1) - polygon
    # Coordinates apart, points x edges of each pair: sums over an axis of two take most of the time otherwise.
    (x, y), (from_x, from_y), (edge_x, edge_y) = (
        np.moveaxis(each, -1, 0) for each in (points[:, :, None], polygon[:, None], edges[:, None])
    )
    x, y, length2 = x - from_x, y - from_y, edge_x**2 + edge_y**2
    along = (x * edge_x + y * edge_y) / np.where(length2 > 0, length2, 1.0)
    along = np.clip(along, 0.0, 1.0)
    gap2 = (x - along * edge_x) ** 2 + (y - along * edge_y) ** 2
    return np.sqrt(gap2.min(axis=(1, 2)))


def _depth(
    a: Float[np.ndarray, "pairs 4 2"], b: Float[np.ndarray, "pairs points 2"]
) -> Float[np.ndarray, " pairs"]:
    """Largest separation along a's edge normals: negative where none of them separates a from b."""
    edge = np.roll(a, -1, axis=1) - a
    length = np.sqrt(np.sum(edge**2, axis=-1))
    normal = np.stack([edge[..., 1], -edge[..., 0]], axis=-1)
    normal = normal / np.where(length > 0, length, 1.0)[..., None]
    reach = np.einsum("pen,pvn->pev", normal, b).min(axis=-1) - np.einsum("pen,pen->pe", normal, a)
    return np.where(length > 0, reach, -np.inf).max(axis=1)


def _polygon_distance(
    a: Float[np.ndarray, "pairs 4 2"], b: Float[np.ndarray, "pairs points 2"]
) -> Float[np.ndarray, " pairs"]:
    """Signed distance of polygon a to polygon b (or to a single point)."""
    gap, distance = _depth(a, b), _corner_to_edge(b, a)
    if b.shape[1] > 1:
        gap, distance = np.maximum(gap, _depth(b, a)), np.minimum(distance, _corner_to_edge(a, b))
    # If neither shape has an edge (two disks), cores cannot overlap, and the centres' distance is the result.
    return np.where((gap <= 0) & np.isfinite(gap), gap, distance)


_Indices = tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]


def _pairs(shapes: _Shapes, room: Float[np.ndarray, " shapes"], *, close: bool) -> _Indices:
    """Indices of the pairs to measure: bodies of two objects, and regions with others' bodies.

    Args:
        shapes: Of some scenes.
        room: How far each shape lies inside the table, m.
        close: Leave out pairs that can't have the least margin of their scene and take no part in V, as shapes farther
            apart than the least distance to the edge, and than the buffer, can't. In scenes of many shapes they always are.
    """
    scene, counts = shapes.scene, np.bincount(shapes.scene)
    beyond = np.full(len(counts), np.inf)
    with np.errstate(invalid="ignore"):  # where a pose is not a number, nothing is left out
        np.minimum.at(beyond, scene, room)
    beyond = np.where(close | (counts > _FEW), np.maximum(beyond, BUFFER), np.inf)
    centre = shapes.corners.mean(axis=1)
    corner = np.sqrt(np.sum((shapes.corners - centre[:, None]) ** 2, axis=-1))
    extent = corner.max(axis=1) + shapes.radius
    parts = [_all_pairs(scene, counts[scene] <= _FEW)]
    for large in np.flatnonzero(counts > _FEW):
        from scipy.spatial import KDTree  # takes long to import, and most runs have no large scenes

        here = np.flatnonzero(scene == large)
        distance = 2 * extent[here].max() + beyond[large]
        one, two = here[KDTree(centre[here]).query_pairs(distance, output_type="ndarray").T]
        parts.append((np.concatenate([one, two]), np.concatenate([two, one])))
    first, second = (np.concatenate(each) for each in zip(*parts, strict=True))
    is_body = shapes.region < 0
    later, apart = (
        compare(shapes.owner[first], shapes.owner[second]) for compare in (np.less, np.not_equal)
    )
    relevant = is_body[second] & np.where(is_body[first], later, apart)
    first, second = first[relevant], second[relevant]
    gap = np.sqrt(np.sum((centre[first] - centre[second]) ** 2, axis=-1))
    near = ~(gap > extent[first] + extent[second] + beyond[scene[first]])
    return first[near], second[near]


def _all_pairs(scene: Int[np.ndarray, " shapes"], among: Bool[np.ndarray, " shapes"]) -> _Indices:
    """Indices of both orders of all pairs of shapes of one scene, and of each shape with itself."""
    begin, end = (np.searchsorted(scene, scene[among], side) for side in ("left", "right"))
    counts = end - begin
    first = np.repeat(np.flatnonzero(among), counts)
    number = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return first, np.repeat(begin, counts) + number


class _Measured(NamedTuple):
    margin: Float[np.ndarray, " rows"]
    kind: Int[np.ndarray, " rows"]
    scene: Int[np.ndarray, " rows"]
    owner: Int[np.ndarray, " rows"]
    region: Int[np.ndarray, " rows"]
    other: Int[np.ndarray, " rows"]
    shared: Bool[np.ndarray, " rows"]  # counts for both objects


def _measure(
    conditions: Sequence[SceneCondition], poses: Sequence[Poses], *, close: bool
) -> _Measured:
    shapes = _collect(conditions, poses)
    half = np.array([[c.width, c.depth] for c in conditions])[shapes.scene] / 2
    inside = half - np.abs(shapes.corners).max(axis=1) - shapes.radius[:, None]
    first, second = _pairs(shapes, inside.min(axis=1), close=close)
    of_region = shapes.region[first] >= 0
    distance = np.empty(len(first))
    bodies, regions = np.nonzero(~of_region)[0], np.nonzero(of_region)[0]
    distance[bodies] = _polygon_distance(
        shapes.corners[first[bodies]], shapes.corners[second[bodies]]
    )
    distance[regions] = _polygon_distance(
        shapes.corners[second[regions]], shapes.corners[first[regions], :1]
    )
    distance -= shapes.radius[first] + shapes.radius[second]
    walls = len(shapes.radius)
    room, balanced = _balance(conditions, poses)
    nobody = np.full(len(room), -1)
    return _Measured(
        np.concatenate([distance, inside[:, 0], inside[:, 1], room]),
        np.concatenate(
            [np.where(of_region, 1, 0), *[np.where(shapes.region < 0, 2, 3)] * 2, nobody + 5]
        ),
        np.concatenate([shapes.scene[first], shapes.scene, shapes.scene, balanced]),
        np.concatenate([shapes.owner[first], shapes.owner, shapes.owner, nobody]),
        np.concatenate([shapes.region[first], shapes.region, shapes.region, nobody]),
        np.concatenate([shapes.owner[second], np.full(2 * walls, -1), nobody]),
        np.concatenate([~of_region, np.zeros(2 * walls + len(room), bool)]),
    )


def _balance(
    conditions: Sequence[SceneCondition], poses: Sequence[Poses]
) -> tuple[Float[np.ndarray, " balanced"], Int[np.ndarray, " balanced"]]:
    """Margin of the centre of mass to its circle (m), and the scenes in which it is required."""
    room, scene = [], []
    for s, (condition, pose) in enumerate(zip(conditions, poses, strict=True)):
        if condition.balance is not None:
            mass = np.array([object_type(name).mass for name in condition.objects])
            centre = mass @ np.asarray(pose, np.float64)[:, :2] / mass.sum()
            away = centre - [condition.balance.x, condition.balance.y]
            room.append(condition.balance.radius - float(np.hypot(*away)))
            scene.append(s)
    return np.array(room, np.float64), np.array(scene, np.int64)


def _verdicts(conditions: Sequence[SceneCondition], poses: Sequence[Poses]) -> list[Verdict]:
    rows, count = _measure(conditions, poses, close=True), len(conditions)
    least = np.full(count, np.inf)
    with np.errstate(invalid="ignore"):  # a NaN margin is reported as a breach
        np.minimum.at(least, rows.scene, rows.margin)
    private = rows.kind != _KINDS.index(Kind.BALANCE)  # V is of private requirements
    hinge = np.maximum(BUFFER - rows.margin, 0.0) ** 2 / 2 * np.where(rows.shared, 2.0, private)
    violation = np.bincount(rows.scene, hinge, minlength=count)
    breaches: list[list[Breach]] = [[] for _ in conditions]
    # `not >=`, so that a NaN margin counts as a breach.
    failing = np.nonzero(~(rows.margin >= 0.0))[0]
    for k in failing[np.argsort(rows.margin[failing])]:
        breaches[rows.scene[k]].append(
            Breach(
                _KINDS[rows.kind[k]],
                int(rows.owner[k]),
                int(rows.region[k]),
                int(rows.other[k]),
                float(rows.margin[k]),
            )
        )
    return [
        Verdict(float(m), float(v), tuple(b))
        for m, v, b in zip(least, violation, breaches, strict=True)
    ]


def judge(conditions: Sequence[SceneCondition], poses: Sequence[Poses]) -> list[Verdict]:
    """Verdicts on scenes.

    Args:
        conditions: One condition per scene.
        poses: x, y (m) and theta (rad) of each object, one array of shape (agents, 3) per scene.
    """
    out: list[Verdict] = []
    for start in range(0, len(conditions), _CHUNK):
        out += _verdicts(conditions[start : start + _CHUNK], poses[start : start + _CHUNK])
    return out


def all_margins(condition: SceneCondition, poses: Poses) -> list[Margin]:
    """Every margin of one scene, the least first.

    Of several between the same two objects (of several shapes, or along both sides of the table) the least one. In a
    scene of many objects, pairs that are far apart are left out.

    Args:
        condition: Of the scene.
        poses: x, y (m) and theta (rad) of each object.
    """
    rows = _measure([condition], [poses], close=False)
    least: dict[tuple[Kind, int, int, int], float] = {}
    for k in np.argsort(rows.margin, kind="stable"):
        key = _KINDS[rows.kind[k]], int(rows.owner[k]), int(rows.region[k]), int(rows.other[k])
        least.setdefault(key, float(rows.margin[k]))
    return [Margin(*key, margin) for key, margin in least.items()]
