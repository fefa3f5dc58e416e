"""What a task says of its model: demonstrations, training data, the field and its weights."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import PRNGKeyArray

from deggflow.files import StrPath
from deggflow.flow import Field, mac_loss
from deggflow.train import Augment, Dataset, SampleLoss

from .options import Recipe


class Part(NamedTuple):
    """One of the two files of a recipe.

    Attributes:
        name: Of the file, without its ending.
        each: Demonstrations of each size.
        seed: Of these demonstrations.
    """

    name: str
    each: int
    seed: int


def parts(recipe: Recipe) -> tuple[Part, Part]:
    """Training and validation data, which share no seed."""
    return (
        Part("training", recipe.training, 2 * recipe.seed),
        Part("validation", recipe.validation, 2 * recipe.seed + 1),
    )


@dataclass(frozen=True)
class TrainingData:
    """What a field is trained on, and how.

    Attributes:
        training: Encoded samples with their conditions.
        validation: Held-out ones.
        loss: Of one sample.
        augment: A symmetry of the data, drawn at random in training.
        statistics: Of the training set, where the field is scaled by them.
        remarks: What the card says of the data besides their recipe.
        card: What else the card holds, for instance what `load` needs.
    """

    training: Dataset
    validation: Dataset
    loss: SampleLoss = mac_loss
    augment: Augment | None = None
    statistics: Any = None
    remarks: Mapping[str, Any] = field(default_factory=dict)
    card: Mapping[str, Any] = field(default_factory=dict)


class AbstractModel(ABC):
    """Demonstrations, training data, field and weights of a task.

    Attributes:
        task: Name of the task.
        noun: What several demonstrations are called.
        sizes: Least and largest number of agents.
        chunk: Demonstrations that are made and written at once.
        loss_text: The loss in words, for the card.
    """

    task: str
    noun: str
    sizes: tuple[int, int]
    chunk: int
    loss_text: str

    @abstractmethod
    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> Sequence[Mapping[str, Any]]:
        """Demonstrations number `first` to `first + count - 1` of one size, as lines of a file.

        Each depends on the seed and its own number alone, but for rounding; whole chunks are made again after a kill.
        """

    @abstractmethod
    def describe(self, folder: Path) -> Sequence[str]:
        """What `data` tells of the demonstrations in a folder, a line each."""

    @abstractmethod
    def load_data(self, training: Path, validation: Path) -> TrainingData:
        """Encodes two files of demonstrations; `InputError` where one is not as it should be."""

    @abstractmethod
    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> eqx.Module:
        """An untrained field."""

    @abstractmethod
    def load(self, path: StrPath | None = None) -> Field:
        """The field of a weights file and its card, or the shipped one; `InputError` if they are not of this task."""
