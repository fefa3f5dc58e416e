"""Distributional deviation of guided from nominal samples, with upper bounds and a lower bound for every method."""

from .bound import Bounds, bounds, log_bound
from .coupling import Coupled, couple
from .distance import Deviation, assignment, measure, squared_distances, wasserstein
from .growth import Growth, decoder_lipschitz, growth
from .least import Cuts, least_square_sum, lower_confidence
from .steps import drift_along, step_bound

__all__ = [
    "Bounds",
    "Coupled",
    "Cuts",
    "Deviation",
    "Growth",
    "assignment",
    "bounds",
    "couple",
    "decoder_lipschitz",
    "drift_along",
    "growth",
    "least_square_sum",
    "log_bound",
    "lower_confidence",
    "measure",
    "squared_distances",
    "step_bound",
    "wasserstein",
]
