"""Training of nominal fields: AdamW, cosine schedule, averaged weights, exact resumption, extension of a run."""

from .folder import read_curves, run_segments
from .loop import TrainingState, train
from .settings import Augment, Curve, Dataset, Remake, SampleLoss, TrainingConfig
from .store import StoredDataset

__all__ = [
    "Augment",
    "Curve",
    "Dataset",
    "Remake",
    "SampleLoss",
    "StoredDataset",
    "TrainingConfig",
    "TrainingState",
    "read_curves",
    "run_segments",
    "train",
]
