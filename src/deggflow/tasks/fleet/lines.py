"""Lines of the fleet's files as types. Does not import JAX."""

from collections.abc import Sequence
from typing import NotRequired, TypedDict

from deggflow.lines import CertificateLine


class MapLine(TypedDict, total=False):
    """A map without a name, in map units; docs/fleet.md has the order of the numbers."""

    bounds: Sequence[float]
    boxes: Sequence[Sequence[float]]
    discs: Sequence[Sequence[float]]
    polygons: Sequence[Sequence[Sequence[float]]]


class RobotLine(TypedDict):
    """Where a robot starts and where it goes, [x, y] in map units."""

    start: Sequence[float]
    goal: Sequence[float]


class FleetConditionLine(TypedDict):
    """As `FleetCondition` in a file; the map by name, or its geometry."""

    map: str | MapLine
    robots: Sequence[RobotLine]
    radius: NotRequired[float]
    speed_limit: NotRequired[float]


class PlanLine(TypedDict):
    """As `Plan` in a file; paths are lists of [x, y], in map units."""

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
