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
    TABLE_DEPTH,
    TABLE_WIDTH,
    ObjectType,
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


_DEFAULT = Affordance()


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
        return self.requirements.get(name, _DEFAULT)

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
        self.shape, self.agents, self.used = (scenes, agents + extras), agents, [0] * scenes
        self.rows = list[PartRow]()
        self.places = list[tuple[int, int, int]]()  # of the rows: scene, slot, agent

    def add(self, scene: int, agent: int, rows: Sequence[PartRow]) -> None:
        self.rows += rows
        self.places.append((scene, agent, agent))
        for _ in rows[1:]:
            self.places.append((scene, self.agents + self.used[scene], agent))
            self.used[scene] += 1

    def stack(self) -> Parts:
        columns: Any = np.zeros((5, *self.shape), np.float32)
        valid, owner = np.zeros(self.shape, bool), np.zeros(self.shape, np.int32)
        owner[:, : self.agents] = np.arange(self.agents)
        scene, slot, agent = np.array(self.places, np.int32).reshape(-1, 3).T
        columns[:, scene, slot] = np.array(self.rows).reshape(-1, 5).T
        valid[scene, slot], owner[scene, slot] = True, agent
        extra = owner[:, self.agents :, None] == np.arange(self.agents)
        extra = extra & valid[:, self.agents :, None]
        x, y, half_x, half_y, radius = columns
        rest: Any = (valid, owner, extra.astype(np.float32))
        return Parts(x, y, half_x, half_y, radius, *rest)


def primitive_rows(kind: ObjectType) -> list[PartRow]:
    """An object's own body."""
    return [(p.x, p.y, p.half_x - p.corner, p.half_y - p.corner, p.corner) for p in kind.primitives]


def region_rows(kind: ObjectType, need: Affordance) -> list[PartRow]:
    """An object's affordance regions as a user requires them."""
    # As numbers of Python's own, with which arithmetic is faster.
    cos, sin = float(np.cos(need.direction)), float(np.sin(need.direction))
    rows = []
    for region in kind.regions:
        x, y = need.offset_scale * region.x, need.offset_scale * region.y
        rows.append(
            (cos * x - sin * y, sin * x + cos * y, 0.0, 0.0, need.radius_scale * region.radius)
        )
    return rows


def strip_rows(kind: ObjectType, need: Affordance) -> list[PartRow]:
    """For each region, the row of all of the object's: its centre, and how far other centres are to either side of it."""
    return _strips(region_rows(kind, need))


def _strips(rows: Sequence[PartRow]) -> list[PartRow]:
    x, y = (sum(row[k] for row in rows) / len(rows) for k in (0, 1))
    half = max(math.hypot(row[0] - x, row[1] - y) for row in rows)
    return [(x, y, 0.0, half, row[-1]) for row in rows]


def access_rows(kind: ObjectType) -> list[PartRow]:
    """An object's default regions merged into one capsule."""
    xs = [region.x for region in kind.regions]
    centre, half = (max(xs) + min(xs)) / 2, (max(xs) - min(xs)) / 2
    return [(centre, kind.regions[0].y, half, 0.0, kind.regions[0].radius)]


class _Fixed(NamedTuple):
    """What is the same of all objects of a type, whatever the user requires."""

    kind: ObjectType
    number: int
    primitives: list[PartRow]
    access: list[PartRow]


_FIXED = {
    kind.name: _Fixed(kind, number, primitive_rows(kind), access_rows(kind))
    for number, kind in enumerate(LIBRARY)
}


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
            fixed = _FIXED[type_name(name)]
            mask[s, i], kind[s, i], mass[s, i] = True, fixed.number, fixed.kind.mass
            required = region_rows(fixed.kind, condition.affordance(name))
            primitives.add(s, i, fixed.primitives)
            regions.add(s, i, required)
            strips.add(s, i, _strips(required))
            access.add(s, i, fixed.access)
    half = np.array([[c.width, c.depth] for c in conditions], np.float32) / 2
    parts = (one.stack() for one in (primitives, regions, strips, access))
    leaves: Any = (mask, kind, *parts, half[:, 0], half[:, 1], mass, balance)
    return TabletopCondition(*leaves)


def take(condition: TabletopCondition, index: Any) -> TabletopCondition:
    """The scenes at `index` of a stacked condition."""
    return jax.tree.map(lambda leaf: leaf[index], condition)
