"""Decoupled guidance: every agent computes its own input, from states alone."""

from .agent import AgentInput, Told, agent_input, told
from .allocation import AbstractAllocation, Local, LocalPairs, Own, Pooled
from .bound import AbstractBound, TighteningBound
from .decoupled import AbstractGuidance, DecoupledGuidance, GuidanceReport, NoGuidance
from .private import PrivateRequirement, hinge_violation
from .qp import MinNormInput, min_norm_input
from .requirement import AbstractRequirement, Demand, Rows
from .schedule import AbstractSchedule, LinearSchedule, PowerSchedule
from .shared import Recovering, SharedFactor, SharedRequirements
from .sharing import AbstractSharing, AdaptiveShares, EqualShares, FixedShares

__all__ = [
    "AbstractAllocation",
    "AbstractBound",
    "AbstractGuidance",
    "AbstractRequirement",
    "AbstractSchedule",
    "AbstractSharing",
    "AdaptiveShares",
    "AgentInput",
    "DecoupledGuidance",
    "Demand",
    "EqualShares",
    "FixedShares",
    "GuidanceReport",
    "LinearSchedule",
    "Local",
    "LocalPairs",
    "MinNormInput",
    "NoGuidance",
    "Own",
    "Pooled",
    "PowerSchedule",
    "PrivateRequirement",
    "Recovering",
    "Rows",
    "SharedFactor",
    "SharedRequirements",
    "TighteningBound",
    "Told",
    "agent_input",
    "hinge_violation",
    "min_norm_input",
    "told",
]
