"""Other ways to guide a flow, behind the same interface: what guidance is compared with."""

from .dual_flow import DualFlow
from .endpoint_projection import EndpointProjection
from .joint_barrier import JointBarrier
from .penalty_gradient import PenaltyGradient
from .prediction_correction import FadingField, predict_then_correct
from .rival import AbstractRival, Constraints
from .split_barrier import SplitBarrier

__all__ = [
    "AbstractRival",
    "Constraints",
    "DualFlow",
    "EndpointProjection",
    "FadingField",
    "JointBarrier",
    "PenaltyGradient",
    "SplitBarrier",
    "predict_then_correct",
]
