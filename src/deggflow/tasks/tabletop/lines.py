"""Lines of the tabletop's files as types. Does not import JAX."""

from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from deggflow.lines import CertificateLine


class AffordanceLine(TypedDict, total=False):
    """A user's requirement on the affordance regions of one object; direction in rad."""

    offset_scale: float
    radius_scale: float
    direction: float


class TableLine(TypedDict):
    """Size of the table, m."""

    width: float
    depth: float


class BalanceLine(TypedDict, total=False):
    """Circle for the centre of mass, m."""

    x: float
    y: float
    radius: float


class SceneConditionLine(TypedDict):
    """As `SceneCondition` in a file."""

    objects: Sequence[str]
    requirements: NotRequired[Mapping[str, AffordanceLine]]
    table: NotRequired[TableLine]
    balance: NotRequired[BalanceLine]


class PoseLine(TypedDict):
    """Pose of one object; m and rad."""

    name: str
    x: float
    y: float
    theta: float


class SceneLine(TypedDict):
    """As `Scene` in a file."""

    condition: SceneConditionLine
    objects: Sequence[PoseLine]
    certificate: CertificateLine
    seed: int


LINES = (SceneLine,)
