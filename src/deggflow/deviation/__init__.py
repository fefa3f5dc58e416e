"""Distributional deviation of guided from nominal samples, and its upper bounds."""

from .bound import Bounds, bounds, log_bound
from .coupling import Coupled, couple
from .distance import Deviation, assignment, measure, squared_distances, wasserstein
from .growth import Growth, decoder_lipschitz, growth

__all__ = [
    "Bounds",
    "Coupled",
    "Deviation",
    "Growth",
    "assignment",
    "bounds",
    "couple",
    "decoder_lipschitz",
    "growth",
    "log_bound",
    "measure",
    "squared_distances",
    "wasserstein",
]
