"""Decoupled guidance: every agent computes its own input, from states alone."""

from .agent import AgentInput, CommunicationCost, agent_input, communication_cost
from .allocation import AbstractAllocation, Fixed, Local, Own, Pooled
from .bound import AbstractBound, TighteningBound
from .decoupled import AbstractGuidance, DecoupledGuidance, NoGuidance
from .margins import (
    AbstractMargins,
    AbstractNamedMargins,
    MarginLabel,
    Margins,
    Pairs,
    distances,
    hinge_violation,
    safe_norm,
)
from .private import PrivateRequirement
from .qp import MinNormInput, min_norm_input
from .report import GuidanceReport, report_without_rows
from .requirement import AbstractRequirement, Demand, Rows
from .schedule import AbstractSchedule, LinearSchedule, PowerSchedule
from .shared import Recovering, SharedFactor, SharedRequirements
from .sums import SumOfMargins

__all__ = [
    "AbstractAllocation",
    "AbstractBound",
    "AbstractGuidance",
    "AbstractMargins",
    "AbstractNamedMargins",
    "AbstractRequirement",
    "AbstractSchedule",
    "AgentInput",
    "CommunicationCost",
    "DecoupledGuidance",
    "Demand",
    "Fixed",
    "GuidanceReport",
    "LinearSchedule",
    "Local",
    "MarginLabel",
    "Margins",
    "MinNormInput",
    "NoGuidance",
    "Own",
    "Pairs",
    "Pooled",
    "PowerSchedule",
    "PrivateRequirement",
    "Recovering",
    "Rows",
    "SharedFactor",
    "SharedRequirements",
    "SumOfMargins",
    "TighteningBound",
    "agent_input",
    "communication_cost",
    "distances",
    "hinge_violation",
    "min_norm_input",
    "report_without_rows",
    "safe_norm",
]
