"""Lines of files as types: certificates and records. Tables make their columns from these (docs/scale.md)."""

from collections.abc import Sequence
from typing import NotRequired, TypedDict


class RequirementLine(TypedDict):
    """As `certificate.RequirementRecord` in a file."""

    name: str
    value: float
    limit: float
    excess: float
    active_points: int
    smallest_ell_norm: float | None
    forced_steps: NotRequired[int]
    forced_agents: NotRequired[Sequence[str]]
    kink_points: NotRequired[int]


class TraceLine(TypedDict):
    """As `certificate.TraceRecord` in a file."""

    tau: Sequence[float]
    value: Sequence[Sequence[float]]
    bound: Sequence[Sequence[float]]
    limit: Sequence[Sequence[float]]


class LostLine(TypedDict):
    """As `certificate.LostAgent` in a file."""

    agent: str
    tau: float


class GenerationLine(TypedDict):
    """As `certificate.GenerationRecord` in a file."""

    hypotheses_hold: bool
    first_failure: str | None
    requirements: Sequence[RequirementLine]
    steps: int
    refused_steps: int
    forced_steps: int
    least_opposed_sine: float | None
    largest_input_norm: float
    largest_step: float
    trace: NotRequired[TraceLine]
    lost: NotRequired[Sequence[LostLine]]


class VerdictLine(TypedDict):
    """As `certificate.RequirementVerdict` in a file."""

    name: str
    margin: float
    reason: str | None


class CertificateLine(TypedDict):
    """As `certificate.Certificate` in a file."""

    satisfied: bool
    min_margin: float
    violation: float
    draws: int
    reason: str | None
    generation: NotRequired[GenerationLine]
    verdicts: NotRequired[Sequence[VerdictLine]]
