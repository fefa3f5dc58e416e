"""Inputs and outputs of a training run: data, settings, points of the curves."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from deggflow.shapes import Scalar, States

SampleLoss = Callable[..., Scalar]
"""Loss of one sample: (field, tau, x0, x1, condition, mask) -> scalar, as `mac_loss`."""
Augment = Callable[[PRNGKeyArray, States, Any], States]

_MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers


class Dataset(NamedTuple):
    """Encoded data with its conditions; all leaves have a leading axis of samples.

    Attributes:
        z: Encoded states of the agents.
        condition: Conditions, a tree of arrays.
        mask: True for agents that are present, False for padding.
    """

    z: Float[Array, "samples agents dim"]
    condition: Any
    mask: Bool[Array, "samples agents"]


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of a training run. Its result is the averaged weights after the last step.

    Attributes:
        steps: Number of steps, a multiple of `validate_every`.
        batch: Samples per step.
        learning_rate: Peak of the cosine schedule.
        warmup: Steps of the warm-up, at most a tenth of a segment.
        weight_decay: Weight decay of AdamW.
        average: Decay of the averaged weights; those k steps back have weight average^k.
        seed: Seed of batches, noise and tau.
        validate_every: Steps between points of the curves, at which checkpoints are written.

    Raises:
        ValueError: A setting is out of range; the error names it.
    """

    steps: int = 50_000
    batch: int = 256
    learning_rate: float = 1.5e-3
    warmup: int = 500
    weight_decay: float = 1e-4
    average: float = 0.999
    seed: int = 0
    validate_every: int = 500

    def __post_init__(self) -> None:
        for name, least in {"validate_every": 1, "batch": 1, "warmup": 0, "seed": 0}.items():
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise ValueError(f"`{name}` must be an integer of at least {least}; got {value!r}.")
        if self.seed > _MAX_SEED:
            raise ValueError(f"`seed` must be at most {_MAX_SEED}; got {self.seed}.")
        if not 0 < self.learning_rate < math.inf:
            raise ValueError(f"`learning_rate` must be positive; got {self.learning_rate}.")
        if not 0 <= self.weight_decay < math.inf:
            raise ValueError(f"`weight_decay` must not be negative; got {self.weight_decay}.")
        if not 0 <= self.average < 1:
            raise ValueError(f"`average` must lie in [0, 1); got {self.average}.")
        if not isinstance(self.steps, int) or self.steps % self.validate_every or self.steps <= 0:
            raise ValueError(
                f"`steps` must be a positive multiple of `validate_every` ({self.validate_every}), "
                f"as checkpoints are written there; got {self.steps!r}."
            )


Remake = Callable[[Mapping[str, Any], TrainingConfig, Sequence[int]], list[str]]
"""(recipe of the data, settings, ends of the segments) -> commands that train the same weights again."""


class Curve(NamedTuple):
    """One point of the training curves.

    Attributes:
        step: Number of completed steps.
        training: Mean loss since the previous point.
        validation: Loss of the averaged weights on held-out data.
    """

    step: int
    training: float
    validation: float


def check_samples(name: str, data: Dataset) -> None:
    """Checks that a dataset has samples, and the same number in all its parts.

    Raises:
        ValueError: It has none, or a part has another number; the error names it.
    """
    count = len(data.mask)
    if not count:
        raise ValueError(f"`{name}` must hold at least one sample; got none.")
    for path, leaf in jax.tree_util.tree_leaves_with_path(data):
        if leaf.shape[:1] != (count,):
            raise ValueError(
                f"`{name}{jax.tree_util.keystr(path)}` must have {count} samples along its first axis, as the mask; "
                f"got shape {leaf.shape}."
            )
