"""Conditions of fleet plans, and the padded arrays that compiled programs read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.requirements import polygon
from deggflow.shapes import Scalar

from .maps import NAMED, RADIUS, FloorMap

SPEED_LIMIT = 0.12  # map units per step from a waypoint to the next
APART = 2.1  # radii between centres of two robots: MMD's own check
MIN_ROBOTS, MAX_ROBOTS = 1, 64
SIZES = (
    3,
    6,
    9,
    15,
    20,
    30,
    40,
    64,
)  # padded teams; one compiled program serves every N up to its size
PLACES = tuple(4**k for k in range(1, 10))  # padded numbers of obstacles of each kind
NOWHERE = 1e3  # map units, where obstacles and robots that stand for none are


@dataclass(frozen=True)
class Robot:
    """Where a robot starts and where it must end, in map units."""

    start: tuple[float, float]
    goal: tuple[float, float]


@dataclass(frozen=True)
class FleetCondition:
    """One problem of motion planning.

    Attributes:
        map: Name of a map, or bounds and obstacles.
        robots: Starts and goals.
        radius: Of every robot, in map units.
        speed_limit: Longest step from a waypoint to the next, in map units.
        given: The JSON object it was read from.
    """

    map: str | FloorMap
    robots: tuple[Robot, ...]
    radius: float = RADIUS
    speed_limit: float = SPEED_LIMIT
    given: Mapping[str, Any] | None = field(default=None, compare=False)

    @property
    def floor(self) -> FloorMap:
        """Bounds and obstacles, of named maps, too."""
        return NAMED[self.map] if isinstance(self.map, str) else self.map

    @property
    def starts(self) -> Float[np.ndarray, "robots 2"]:
        """Where robots start, in float64."""
        return np.array([robot.start for robot in self.robots])

    @property
    def goals(self) -> Float[np.ndarray, "robots 2"]:
        """Where robots end, in float64."""
        return np.array([robot.goal for robot in self.robots])

    def to_json(self) -> dict[str, Any]:
        """The condition as it stands in a file: as it was read, or only what differs from the defaults."""
        if self.given is not None:
            return dict(self.given)
        out: dict[str, Any] = {
            "map": self.map if isinstance(self.map, str) else self.map.to_json(),
            "robots": [{"start": list(r.start), "goal": list(r.goal)} for r in self.robots],
        }
        if self.radius != RADIUS:
            out["radius"] = self.radius
        if self.speed_limit != SPEED_LIMIT:
            out["speed_limit"] = self.speed_limit
        return out


class FleetArrays(NamedTuple):
    """One condition as arrays. Obstacles that stand for none are far away.

    Attributes:
        mask: Which robots are present.
        start: Starts; of absent robots far away, each elsewhere.
        goal: Goals, likewise.
        radius: Of every robot.
        speed_limit: Longest step.
        bounds: Least x and y, largest x and y.
        solids: Boxes and discs as grown boxes: centre, half sizes, and the radius by which they are grown.
        triangles: Corners of convex pieces of polygons, counter-clockwise.
    """

    mask: Bool[Array, " agents"]
    start: Float[Array, "agents 2"]
    goal: Float[Array, "agents 2"]
    radius: Scalar
    speed_limit: Scalar
    bounds: Float[Array, " 4"]
    solids: Float[Array, "solids 5"]
    triangles: Float[Array, "triangles 3 2"]


class Padding(NamedTuple):
    """Sizes of the arrays of several conditions.

    Attributes:
        agents: Robots.
        solids: Boxes and discs.
        triangles: Pieces of polygons.
    """

    agents: int
    solids: int
    triangles: int


def padded_size(agents: int) -> int:
    """Smallest padded team that holds so many robots."""
    return next(size for size in SIZES if size >= agents)


def _places(count: int) -> int:
    return 0 if count == 0 else next(size for size in PLACES if size >= count)


def triangles(floor: FloorMap) -> Float[np.ndarray, "triangles 3 2"]:
    """All polygons cut into triangles, counter-clockwise."""
    rings = [polygon.counter_clockwise(np.array(corners)) for corners in floor.polygons]
    return np.concatenate([np.zeros((0, 3, 2)), *(polygon.triangles(ring) for ring in rings)])


def solids(floor: FloorMap) -> Float[np.ndarray, "solids 5"]:
    """Boxes and discs as grown boxes: centre, half sizes, radius."""
    rows = [(x, y, w / 2, h / 2, 0.0) for x, y, w, h in floor.boxes]
    rows += [(x, y, 0.0, 0.0, r) for x, y, r in floor.discs]
    return np.array(rows).reshape(-1, 5)


def padding(conditions: Sequence[FleetCondition]) -> Padding:
    """Sizes that hold every one of some conditions."""
    floors = {id(condition.floor): condition.floor for condition in conditions}.values()
    return Padding(
        padded_size(max(len(condition.robots) for condition in conditions)),
        *(
            _places(max(sizes))
            for sizes in zip(*((len(solids(f)), len(triangles(f))) for f in floors), strict=True)
        ),
    )


def _filled(
    rows: Float[np.ndarray, "rows ..."], count: int, absent: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "count ..."]:
    out = np.empty((count, *absent.shape), np.float32)
    out[:] = absent
    out[: len(rows)] = rows
    return out


def _one(condition: FleetCondition, sizes: Padding) -> FleetArrays:
    floor, count = condition.floor, len(condition.robots)
    far = np.zeros((sizes.agents, 2), np.float32)
    far[:, 0] = NOWHERE + np.arange(sizes.agents)
    start, goal = far.copy(), far.copy()
    start[:count], goal[:count] = condition.starts, condition.goals
    corners = NOWHERE + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    leaves: Any = (
        np.arange(sizes.agents) < count,
        start,
        goal,
        np.float32(condition.radius),
        np.float32(condition.speed_limit),
        np.array(floor.bounds, np.float32),
        _filled(solids(floor), sizes.solids, np.array([NOWHERE, NOWHERE, 1, 1, 0])),
        _filled(triangles(floor), sizes.triangles, corners),
    )
    return FleetArrays(*leaves)


def to_arrays(conditions: Sequence[FleetCondition], sizes: Padding | None = None) -> FleetArrays:
    """Some conditions stacked into arrays of float32, padded to the same sizes."""
    sizes = padding(conditions) if sizes is None else sizes
    each = [_one(condition, sizes) for condition in conditions]
    stacked: Any = (np.stack(leaves) for leaves in zip(*each, strict=True))
    return FleetArrays(*stacked)
