"""Named requirements that compose: each knows its margins, buffer, verdict, unit, and who depends on whom.

`a + b` has one V for both; a tuple of requirements has one for each. docs/requirements.md lists them.
"""

from .apart import apart
from .bodies import bodies_apart
from .equality import Solution, equal, solve
from .grid import Grid
from .layout import POINTS, Layout, poses, trajectories
from .logic import (
    AbstractFormula,
    Always,
    Eventually,
    Until,
    Within,
    Without,
    satisfies,
)
from .modes import SmoothModes
from .motion import acceleration, curvature, deadline, near, path_length, speed
from .placement import inside, outside
from .regions import AbstractObstacle, AbstractRegion, Box, Disc, Polygon, Polygons, Union
from .team import centroid, connected, formation, heading, neighbour
from .term import AbstractTerm

__all__ = [
    "POINTS",
    "AbstractFormula",
    "AbstractObstacle",
    "AbstractRegion",
    "AbstractTerm",
    "Always",
    "Box",
    "Disc",
    "Eventually",
    "Grid",
    "Layout",
    "Polygon",
    "Polygons",
    "SmoothModes",
    "Solution",
    "Union",
    "Until",
    "Within",
    "Without",
    "acceleration",
    "apart",
    "bodies_apart",
    "centroid",
    "connected",
    "curvature",
    "deadline",
    "equal",
    "formation",
    "heading",
    "inside",
    "near",
    "neighbour",
    "outside",
    "path_length",
    "poses",
    "satisfies",
    "solve",
    "speed",
    "trajectories",
]
