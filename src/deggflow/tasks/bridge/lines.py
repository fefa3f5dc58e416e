"""Lines of the bridge's files as types. Does not import JAX."""

from collections.abc import Sequence
from typing import Literal, NotRequired, TypedDict

from deggflow.lines import GenerationLine


class PlankLine(TypedDict):
    """A pose of the plank; m and rad."""

    x: float
    y: float
    theta: float


class TrialConditionLine(TypedDict):
    """As `TrialCondition` in a file; contacts are pairs [r_x, r_y] in the plank's frame, m."""

    plank: PlankLine
    goal: PlankLine
    contacts: Sequence[Sequence[float]]


class OutcomeLine(TypedDict):
    """How a trial ended."""

    success: bool
    reason: str | None


class PolicyLine(TypedDict):
    """As `PolicyRecord` in a file."""

    q_task: float
    bound: float
    q_safe: float
    draws: int
    accepted: bool
    speed: NotRequired[float]
    generation: NotRequired[GenerationLine]


class TrialCertificateLine(TypedDict):
    """As `TrialCertificate` in a file."""

    satisfied: bool
    min_margin: float
    violation: float
    draws: int
    reason: str | None
    policies: Sequence[PolicyLine]
    speed_limit: NotRequired[float]


class TrialLine(TypedDict):
    """As `Trial` in a file; twists are triples [v_x, v_y, omega], poses triples [x, y, theta]; m, s and rad."""

    condition: TrialConditionLine
    dt: float
    twists: Sequence[Sequence[float]]
    poses: Sequence[Sequence[float]]
    outcome: OutcomeLine
    certificate: TrialCertificateLine
    seed: int


class ApproachLine(TypedDict):
    """How a demonstration approaches the goal."""

    side: Literal["left", "right"]
    turn: Literal["early", "late"]
    detour: float
    pace: float


class DemonstrationLine(TypedDict):
    """As `Demonstration` in a file."""

    condition: TrialConditionLine
    approach: ApproachLine
    twists: Sequence[Sequence[float]]
    bridged: int
    seed: int
    number: int


LINES = (TrialLine, DemonstrationLine)
