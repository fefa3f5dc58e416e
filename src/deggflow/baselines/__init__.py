"""Baselines: alternative methods for guiding a flow, with the interface of `DecoupledGuidance`."""

from .baseline import AbstractBaseline, AbstractStateless, Constraints
from .dual_flow import DualFlow, Multipliers
from .endpoint_projection import EndpointProjection
from .joint_barrier import JointBarrier
from .penalty_gradient import PenaltyGradient
from .prediction_correction import FadingField, predict_then_correct
from .split_barrier import SplitBarrier

__all__ = [
    "AbstractBaseline",
    "AbstractStateless",
    "Constraints",
    "DualFlow",
    "EndpointProjection",
    "FadingField",
    "JointBarrier",
    "Multipliers",
    "PenaltyGradient",
    "SplitBarrier",
    "predict_then_correct",
]
