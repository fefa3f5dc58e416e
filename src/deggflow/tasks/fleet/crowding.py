"""How many boxes and discs one step of a robot can be within reach of."""

from collections.abc import Sequence

import numpy as np

from .condition import FleetCondition, solids
from .requirements import BUFFER, Crowding

FEW = 16  # discs, of which all are looked at
ROOM = 0.001  # map units, for the smoothing of distances and rounding


def crowding(conditions: Sequence[FleetCondition]) -> Crowding:
    """What is enough for every one of some conditions.

    A step within the speed limit whose middle is farther from an obstacle than half its length, the radius and the buffer
    is beyond reach of it. Obstacles farther from each other than twice that are never within reach at once.

    Example:
        >>> from .condition import Robot
        >>> crowding([FleetCondition("conveyor", (Robot((-0.8, 0.0), (0.8, 0.0)),), speed_limit=0.1)])
        Crowding(nearest=1, polygons=False)
    """
    most, polygons, few_discs = 0, False, True
    for key in {(c.map, c.radius, c.speed_limit): c for c in conditions}.values():
        rows = solids(key.floor)
        polygons = polygons or bool(key.floor.polygons)
        if not len(rows):
            continue
        reach = key.radius + BUFFER + key.speed_limit / 2 + ROOM
        gap = (
            np.abs(rows[:, None, :2] - rows[None, :, :2]) - rows[:, None, 2:4] - rows[None, :, 2:4]
        )
        few_discs = few_discs and not key.floor.boxes and len(rows) <= FEW
        apart = np.linalg.norm(np.maximum(gap, 0.0), axis=-1) - rows[:, None, 4] - rows[None, :, 4]
        most = max(most, int((apart < 2 * reach).sum(1).max()))
    return Crowding(most, polygons, few_discs and most > 0)
