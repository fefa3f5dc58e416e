"""Lines of the fleet's files as types. Does not import JAX."""

from collections.abc import Sequence
from typing import NotRequired, TypedDict

from deggflow.lines import CertificateLine


class FloorLine(TypedDict, total=False):
    """Bounds and obstacles, map units."""

    bounds: Sequence[float]
    boxes: Sequence[Sequence[float]]
    discs: Sequence[Sequence[float]]
    polygons: Sequence[Sequence[Sequence[float]]]


class RobotLine(TypedDict):
    """Start and goal of one robot, map units."""

    start: Sequence[float]
    goal: Sequence[float]


class FleetConditionLine(TypedDict):
    """As `FleetCondition` in a file."""

    map: str | FloorLine
    robots: Sequence[RobotLine]
    radius: NotRequired[float]
    speed_limit: NotRequired[float]


class PlanLine(TypedDict):
    """As `Plan` in a file."""

    condition: FleetConditionLine
    paths: Sequence[Sequence[Sequence[float]]]
    certificate: CertificateLine
    seed: int


class DemonstrationLine(TypedDict):
    """As `Demonstration` in a file."""

    condition: FleetConditionLine
    paths: Sequence[Sequence[Sequence[float]]]
    seed: int
    number: int


LINES = (PlanLine, DemonstrationLine)
