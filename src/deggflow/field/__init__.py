"""Nominal vector fields."""

from .features import TIME_FEATURES, TeamFeatures, stack_features, time_features
from .message_passing import MessagePassingField

__all__ = [
    "TIME_FEATURES",
    "MessagePassingField",
    "TeamFeatures",
    "stack_features",
    "time_features",
]
