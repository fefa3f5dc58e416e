"""How often the nominal field is evaluated: at every step of the guidance, or once or twice in each longer macro step.

The guarantees concern the drift that is integrated, whatever it is (docs/theory.md, section 3). Between two evaluations
of the field it may therefore be held or extrapolated, while guidance takes steps of its own. Along a step of the
guidance's grid an approximated drift is constant: the mean of the approximation over that step. The nominal part of the
path is then integrated exactly, and halving a step changes nothing about it.
"""

from .base import AbstractDrift, Interval, aligned, macro_grid
from .endpoint import ExtrapolatedEndpoint
from .held import EVERY_STEP, EveryStep, Held, Midpoint
from .multistep import Extrapolated
from .prediction import AfterPrediction

__all__ = [
    "EVERY_STEP",
    "AbstractDrift",
    "AfterPrediction",
    "EveryStep",
    "Extrapolated",
    "ExtrapolatedEndpoint",
    "Held",
    "Interval",
    "Midpoint",
    "aligned",
    "macro_grid",
]
