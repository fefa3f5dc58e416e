"""Training of nominal fields: AdamW, cosine schedule, averaged weights, exact resumption, extension of a run."""

from typing import TYPE_CHECKING

from deggflow.lazy import lazy_names

from .folder import read_curves, run_segments
from .settings import Augment, Curve, Dataset, Remake, SampleLoss, TrainingConfig
from .store import StoredDataset

if TYPE_CHECKING:
    from .loop import TrainingState, train

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

# Whoever generates does without Optax.
__getattr__ = lazy_names(__name__, {"loop": ("TrainingState", "train")})
