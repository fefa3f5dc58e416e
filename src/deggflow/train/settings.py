"""What a training run is given and what it tells: data, settings, points of the curves."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

SampleLoss = Callable[..., Float[Array, ""]]
"""Loss of one sample: (field, tau, x0, x1, condition, mask) -> scalar, as `mac_loss`."""
Augment = Callable[[PRNGKeyArray, Float[Array, "agents dim"], Any], Float[Array, "agents dim"]]

_MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers


class Dataset(NamedTuple):
    """Encoded data with its conditions; all leaves have a leading sample axis."""

    z: Float[Array, "samples agents dim"]
    condition: Any
    mask: Bool[Array, "samples agents"]


@dataclass(frozen=True)
class TrainingConfig:
    """How a field is trained. The last step's averaged weights are the result.

    Raises:
        ValueError: A setting lies outside of its range; it is named.
    """

    steps: int = 50_000
    batch: int = 256
    learning_rate: float = 1.5e-3  # peak of the cosine schedule
    warmup: int = 500  # steps; a tenth of a segment at most
    weight_decay: float = 1e-4
    average: float = 0.999  # decay of the averaged weights: those k steps back count average^k
    seed: int = 0
    validate_every: int = 500  # steps between points of the curves and checkpoints

    def __post_init__(self) -> None:
        for name, least in {"validate_every": 1, "batch": 1, "warmup": 0, "seed": 0}.items():
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise ValueError(f"`{name}` must be an integer from {least} on; got {value!r}.")
        if self.seed > _MAX_SEED:
            raise ValueError(f"`seed` must be {_MAX_SEED} at most; got {self.seed}.")
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
    """One point of the training curves."""

    step: int
    training: float  # mean loss since the point before
    validation: float  # loss of the averaged weights on held-out data


def check_samples(name: str, data: Dataset) -> None:
    """Refuses data without samples, or of which some parts have more samples than others, by name."""
    count = len(data.mask)
    if not count:
        raise ValueError(f"`{name}` must hold at least one sample; got none.")
    for path, leaf in jax.tree_util.tree_leaves_with_path(data):
        if leaf.shape[:1] != (count,):
            raise ValueError(
                f"`{name}{jax.tree_util.keystr(path)}` must have {count} samples along its first axis, as the mask; "
                f"got shape {leaf.shape}."
            )
