"""Decoupled guidance: every agent computes its own input, from states alone."""

from .allocation import AbstractAllocation, Local, Own, Pooled
from .decoupled import AbstractGuidance, DecoupledGuidance, GuidanceReport, NoGuidance
from .private import PrivateRequirement, hinge_violation
from .qp import MinNormInput, min_norm_input
from .requirement import AbstractRequirement, Rows
from .schedule import AbstractSchedule, LinearSchedule

__all__ = [
    "AbstractAllocation",
    "AbstractGuidance",
    "AbstractRequirement",
    "AbstractSchedule",
    "DecoupledGuidance",
    "GuidanceReport",
    "LinearSchedule",
    "Local",
    "MinNormInput",
    "NoGuidance",
    "Own",
    "Pooled",
    "PrivateRequirement",
    "Rows",
    "hinge_violation",
    "min_norm_input",
]
