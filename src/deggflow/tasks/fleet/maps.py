"""Floors on which robots move: named maps, random ones, and a user's own obstacles.

The named maps are geometry from yoraish/mmd (empty, conveyor, highways, drop_region; MMD, ICLR 2025) and from
RAISELab-atUVA/Diffusion-MRMP (dense), as numbers in map units.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

BOUNDS = (-1.0, -1.0, 1.0, 1.0)
RADIUS = 0.05  # map units, of robots

Box = tuple[float, float, float, float]
Disc = tuple[float, float, float]
Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FloorMap:
    """Bounds and obstacles of a floor, in map units.

    Attributes:
        bounds: Least x and y, largest x and y.
        boxes: Centre and full width and height of each.
        discs: Centre and radius of each.
        polygons: Corners of each, in either direction; simple, not necessarily convex.
    """

    bounds: tuple[float, float, float, float] = BOUNDS
    boxes: tuple[Box, ...] = ()
    discs: tuple[Disc, ...] = ()
    polygons: tuple[Corners, ...] = ()

    @property
    def obstacles(self) -> int:
        """Number of obstacles of all kinds."""
        return len(self.boxes) + len(self.discs) + len(self.polygons)

    def to_json(self) -> dict[str, Any]:
        """The JSON object of a map without a name; kinds that it does not have are left out."""
        out: dict[str, Any] = {"bounds": list(self.bounds)}
        if self.boxes:
            out["boxes"] = [list(box) for box in self.boxes]
        if self.discs:
            out["discs"] = [list(disc) for disc in self.discs]
        if self.polygons:
            out["polygons"] = [[list(corner) for corner in each] for each in self.polygons]
        return out


_CONVEYOR = ((0.0, 0.0, 0.8, 0.1), (0.0, 0.35, 1.0, 0.1), (0.0, -0.35, 1.0, 0.1))
_HIGHWAYS = (
    (0.0, 0.0, 0.5, 0.5),
    (0.0, 0.875, 0.5, 0.25),
    (0.0, -0.875, 0.5, 0.25),
    (0.875, 0.0, 0.25, 0.5),
    (-0.875, 0.0, 0.25, 0.5),
    (0.875, 0.875, 0.25, 0.25),
    (0.875, -0.875, 0.25, 0.25),
    (-0.875, 0.875, 0.25, 0.25),
    (-0.875, -0.875, 0.25, 0.25),
)
_DROP_REGION = tuple((x, y, 0.4, 0.4) for y in (0.4, -0.4) for x in (0.4, -0.4))
_DENSE = (
    (-0.43378472328186035, 0.3334643840789795),
    (0.3313474655151367, 0.6288051009178162),
    (-0.5656964778900146, -0.484994500875473),
    (0.42124247550964355, -0.6656165719032288),
    (0.05636655166745186, -0.5149664282798767),
    (-0.36961784958839417, -0.12315540760755539),
    (-0.8740217089653015, -0.4034936726093292),
    (-0.6359214186668396, 0.6683124899864197),
    (0.808782160282135, 0.5287870168685913),
    (-0.023786112666130066, 0.4590069353580475),
    (0.11544948071241379, -0.12676022946834564),
    (0.1455741971731186, 0.16420497000217438),
    (0.628413736820221, -0.43461447954177856),
    (0.17965620756149292, -0.8926276564598083),
    (0.6775968670845032, 0.8817358016967773),
    (-0.3608766794204712, 0.8313458561897278),
)
NAMED = {
    "empty": FloorMap(),
    "conveyor": FloorMap(boxes=_CONVEYOR),
    "highways": FloorMap(boxes=_HIGHWAYS),
    "drop_region": FloorMap(boxes=_DROP_REGION),
    "dense": FloorMap(discs=tuple((x, y, 0.125) for x, y in _DENSE)),
}
SPEED_LIMITS = {
    "empty": 0.06,
    "highways": 0.06,
    "conveyor": 0.11,
    "drop_region": 0.11,
    "dense": 0.05,
}  # map units per step, of drawn conditions
# Where MMD's robots wait a while on drop_region: beside the four blocks.
_SIDES = (-0.75, -0.05, 0.05, 0.75)
WAITING_POINTS = tuple((x, y) for x in (0.4, -0.4) for y in _SIDES) + tuple(
    (x, y) for x in _SIDES for y in (0.4, -0.4)
)


def random_map(rng: np.random.Generator, obstacles: int = 8) -> FloorMap:
    """Boxes and discs at random places, a robot's width and more apart from each other and from the bounds."""
    boxes: list[Box] = []
    discs: list[Disc] = []
    circles: list[Disc] = []  # around each obstacle
    for _ in range(50 * obstacles):
        if len(circles) == obstacles:
            break
        half = rng.uniform(0.06, 0.2, 2)
        disc = rng.uniform() < 0.5
        radius = float(half[0] if disc else np.hypot(*half))
        x, y = (float(v) for v in rng.uniform(-0.8 + radius, 0.8 - radius, 2))
        if any(np.hypot(x - a, y - b) < radius + r + 0.25 for a, b, r in circles):
            continue
        circles.append((x, y, radius))
        if disc:
            discs.append((x, y, radius))
        else:
            boxes.append((x, y, float(2 * half[0]), float(2 * half[1])))
    return FloorMap(boxes=tuple(boxes), discs=tuple(discs))
