"""Conditions of tabletop scenes, and the padded arrays that compiled programs read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Scalar

from .library import (
    LIBRARY,
    MAX_OBJECTS,
    NAMES,
    TABLE_DEPTH,
    TABLE_WIDTH,
    ObjectType,
    object_type,
    type_name,
)

SIZES = (6, 8, MAX_OBJECTS)  # padded team sizes; one compiled program serves every N up to its size
EXTRA_PRIMITIVES = sum(len(kind.primitives) - 1 for kind in LIBRARY)
EXTRA_REGIONS = sum(len(kind.regions) - 1 for kind in LIBRARY)


@dataclass(frozen=True)
class Affordance:
    """A user's requirement on the affordance regions of one object (paper: s^o, s^r, varphi)."""

    offset_scale: float = 1.0  # distance of the regions from the object
    radius_scale: float = 1.0  # radius of the regions
    direction: float = 0.0  # rad, about the object's centre


@dataclass(frozen=True)
class Balance:
    """A requirement that all objects share: their centre of mass lies in a circle on the table."""

    x: float = 0.0  # m, from the table's centre
    y: float = 0.0  # m
    radius: float = 0.05  # m


@dataclass(frozen=True)
class SceneCondition:
    """Objects, requirements and table of one scene; `given` is the JSON object it was read from."""

    objects: tuple[str, ...]
    requirements: Mapping[str, Affordance] = field(default_factory=dict)
    width: float = TABLE_WIDTH  # m
    depth: float = TABLE_DEPTH  # m
    balance: Balance | None = None
    given: Mapping[str, Any] | None = field(default=None, compare=False)

    def affordance(self, name: str) -> Affordance:
        """The requirement on one object; the default one if none was stated."""
        return self.requirements.get(name, Affordance())

    def with_requirements(self, requirements: Mapping[str, Affordance]) -> "SceneCondition":
        """The same objects and table under other requirements."""
        return replace(self, requirements=requirements, given=None)

    def to_json(self) -> dict[str, Any]:
        """The condition as it stands in a file: as it was read, or only what differs from the defaults."""
        if self.given is not None:
            return dict(self.given)
        out: dict[str, Any] = {"objects": list(self.objects)}
        if self.requirements:
            out["requirements"] = {
                name: {
                    "offset_scale": need.offset_scale,
                    "radius_scale": need.radius_scale,
                    "direction": need.direction,
                }
                for name, need in self.requirements.items()
            }
        if (self.width, self.depth) != (TABLE_WIDTH, TABLE_DEPTH):
            out["table"] = {"width": self.width, "depth": self.depth}
        if self.balance is not None:
            out["balance"] = asdict(self.balance)
        return out


class Parts(NamedTuple):
    """Rounded boxes fixed to agents. The first `agents` parts belong to the agents in order, the rest are extras."""

    x: Float[Array, " parts"]  # m, in the owner's body frame
    y: Float[Array, " parts"]
    half_x: Float[Array, " parts"]  # m, of the core
    half_y: Float[Array, " parts"]
    radius: Float[Array, " parts"]
    valid: Bool[Array, " parts"]
    owner: Int[Array, " parts"]
    extra_owner: Float[Array, "extras agents"]  # one-hot rows


class TabletopCondition(NamedTuple):
    """One scene's condition chi as arrays, padded to a fixed number of agents."""

    mask: Bool[Array, " agents"]
    kind: Int[Array, " agents"]
    primitives: Parts
    regions: Parts  # as required by the user
    strips: Parts  # of each region: the row of its owner's regions, `half_y` to either side of the way outward
    access: (
        Parts  # default regions of each object merged into one capsule: what the trained field sees
    )
    half_width: Scalar  # m
    half_depth: Scalar  # m
    mass: Float[Array, " agents"]  # kg; zero for padding
    balance: Float[Array, " 3"]  # x, y, radius of the circle for the centre of mass, m


EVERYWHERE = (0.0, 0.0, 1e3)  # m, circle of a scene without a requirement on its balance


def padded_size(agents: int) -> int:
    """Smallest padded team size that holds `agents` objects."""
    return next(size for size in SIZES if size >= agents)


PartRow = tuple[float, float, float, float, float]
"""x, y, half_x, half_y of a core and the radius it is grown by, in m, in the body frame."""


class _PartRows:
    """Collects parts scene by scene as numbers, and stacks them into arrays."""

    def __init__(self, scenes: int, agents: int, extras: int) -> None:
        self.values = np.zeros((scenes, agents + extras, 5), np.float32)
        self.valid = np.zeros((scenes, agents + extras), bool)
        self.owner = np.zeros((scenes, agents + extras), np.int32)
        self.owner[:, :agents] = np.arange(agents)
        self.agents, self.used = agents, np.zeros(scenes, np.int32)

    def add(self, scene: int, agent: int, rows: Sequence[PartRow]) -> None:
        for k, row in enumerate(rows):
            slot = agent if k == 0 else self.agents + self.used[scene]
            self.used[scene] += k > 0
            self.values[scene, slot], self.valid[scene, slot] = row, True
            self.owner[scene, slot] = agent

    def stack(self) -> Parts:
        extra = self.owner[:, self.agents :, None] == np.arange(self.agents)
        extra = extra & self.valid[:, self.agents :, None]
        columns: Any = np.ascontiguousarray(np.moveaxis(self.values, -1, 0))
        x, y, half_x, half_y, radius = columns
        rest: Any = (self.valid, self.owner, extra.astype(np.float32))
        return Parts(x, y, half_x, half_y, radius, *rest)


def primitive_rows(kind: ObjectType) -> list[PartRow]:
    """An object's own body."""
    return [(p.x, p.y, p.half_x - p.corner, p.half_y - p.corner, p.corner) for p in kind.primitives]


def region_rows(kind: ObjectType, need: Affordance) -> list[PartRow]:
    """An object's affordance regions as a user requires them."""
    cos, sin = np.cos(need.direction), np.sin(need.direction)
    rows = []
    for region in kind.regions:
        x, y = need.offset_scale * region.x, need.offset_scale * region.y
        rows.append(
            (cos * x - sin * y, sin * x + cos * y, 0.0, 0.0, need.radius_scale * region.radius)
        )
    return rows


def strip_rows(kind: ObjectType, need: Affordance) -> list[PartRow]:
    """For each region, the row of all of the object's: its centre, and how far other centres are to either side of it."""
    rows = region_rows(kind, need)
    x, y = (sum(row[k] for row in rows) / len(rows) for k in (0, 1))
    half = max(math.hypot(row[0] - x, row[1] - y) for row in rows)
    return [(x, y, 0.0, half, row[-1]) for row in rows]


def access_rows(kind: ObjectType) -> list[PartRow]:
    """An object's default regions merged into one capsule."""
    xs = [region.x for region in kind.regions]
    centre, half = (max(xs) + min(xs)) / 2, (max(xs) - min(xs)) / 2
    return [(centre, kind.regions[0].y, half, 0.0, kind.regions[0].radius)]


def to_arrays(conditions: Sequence[SceneCondition], agents: int | None = None) -> TabletopCondition:
    """Stacks conditions into arrays with a leading scene axis, padded to `agents` (NumPy; the caller moves them)."""
    size = agents or padded_size(max(len(c.objects) for c in conditions))
    count = len(conditions)
    mask, kind = np.zeros((count, size), bool), np.zeros((count, size), np.int32)
    mass, balance = np.zeros((count, size), np.float32), np.zeros((count, 3), np.float32)
    primitives = _PartRows(count, size, EXTRA_PRIMITIVES)
    regions, strips = (_PartRows(count, size, EXTRA_REGIONS) for _ in range(2))
    access = _PartRows(count, size, 0)
    for s, condition in enumerate(conditions):
        circle = condition.balance
        balance[s] = EVERYWHERE if circle is None else (circle.x, circle.y, circle.radius)
        for i, name in enumerate(condition.objects):
            mask[s, i], kind[s, i] = True, NAMES.index(type_name(name))
            mass[s, i] = object_type(name).mass
            primitives.add(s, i, primitive_rows(object_type(name)))
            regions.add(s, i, region_rows(object_type(name), condition.affordance(name)))
            strips.add(s, i, strip_rows(object_type(name), condition.affordance(name)))
            access.add(s, i, access_rows(object_type(name)))
    half = np.array([[c.width, c.depth] for c in conditions], np.float32) / 2
    parts = (one.stack() for one in (primitives, regions, strips, access))
    leaves: Any = (mask, kind, *parts, half[:, 0], half[:, 1], mass, balance)
    return TabletopCondition(*leaves)


def take(condition: TabletopCondition, index: Any) -> TabletopCondition:
    """The scenes at `index` of a stacked condition."""
    return jax.tree.map(lambda leaf: leaf[index], condition)
