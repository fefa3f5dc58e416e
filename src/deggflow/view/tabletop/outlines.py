"""Outlines of the library's objects seen from above, in their body frames."""

from functools import cache

import numpy as np

from deggflow.tasks.tabletop.library import object_type
from deggflow.view.colours import Colour
from deggflow.view.outlines import ROUND, Polygon, silhouette

from .bodies import solids_of


@cache
def footprints(name: str) -> list[Polygon]:
    """Outlines of the library's shapes, in the body frame."""
    outlines = []
    for part in object_type(name).primitives:
        core = np.array([part.half_x - part.corner, part.half_y - part.corner])
        around = np.stack([np.cos(ROUND + 1e-9), np.sin(ROUND + 1e-9)], axis=-1)
        outlines.append(np.sign(around) * core + part.corner * around + [part.x, part.y])
    return outlines


@cache
def silhouettes(name: str) -> list[tuple[Polygon, Colour]]:
    """What is seen of each solid from above; they are listed from the bottom up."""
    return [(silhouette(solid), solid.colour) for solid in solids_of(name)]
