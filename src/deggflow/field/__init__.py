"""Nominal vector fields."""

from .features import TeamFeatures, time_features
from .message_passing import MessagePassingField

__all__ = ["MessagePassingField", "TeamFeatures", "time_features"]
