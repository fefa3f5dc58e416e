"""The interface of a task's model: demonstrations, training data, the field and its weights."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import PRNGKeyArray

from deggflow.files import StrPath
from deggflow.flow import Field, mac_loss
from deggflow.train import Augment, Dataset, SampleLoss, StoredDataset

from .options import Recipe


class Part(NamedTuple):
    """One of the two files of a recipe.

    Attributes:
        name: Name of the file, without its suffix.
        each: Demonstrations of each size.
        seed: Seed of these demonstrations.
    """

    name: str
    each: int
    seed: int


def parts(recipe: Recipe) -> tuple[Part, Part]:
    """Training and validation data, with different seeds."""
    return (
        Part("training", recipe.training, 2 * recipe.seed),
        Part("validation", recipe.validation, 2 * recipe.seed + 1),
    )


@dataclass(frozen=True)
class TrainingData:
    """Data and loss that a field is trained with.

    Attributes:
        training: Encoded samples with their conditions, in memory or in a file.
        validation: Held-out samples with their conditions.
        loss: Loss of one sample.
        augment: Applies a random symmetry of the data during training.
        statistics: Statistics of the training set by which the field is scaled, if it is.
        remarks: Entries of the card about the data, besides their recipe.
        card: Further entries of the card, for instance those that `load` needs.
    """

    training: Dataset | StoredDataset
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
        noun: The word for several demonstrations.
        sizes: Least and largest number of agents.
        chunk: Demonstrations per batch, which are made and written together.
        loss_text: The loss in words, for the card.
        shipped: The weights file that `load` reads by default; None if there is none.
    """

    task: str
    noun: str
    sizes: tuple[int, int]
    chunk: int
    loss_text: str
    shipped: Path | None = None

    @abstractmethod
    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> Sequence[Mapping[str, Any]]:
        """Demonstrations number `first` to `first + count - 1` of one size, as lines of a file.

        Each depends only on the seed and its own number, up to rounding; after a kill, whole chunks are made again.
        """

    @abstractmethod
    def describe(self, folder: Path) -> Sequence[str]:
        """Lines that `data` prints about the demonstrations in a folder."""

    @abstractmethod
    def load_data(
        self, training: Path, validation: Path, scratch: Path | None = None
    ) -> TrainingData:
        """Encodes two files of demonstrations, JSON Lines or tables; raises `InputError` if one is invalid.

        Args:
            training: File of training demonstrations.
            validation: File of validation demonstrations.
            scratch: Folder in which a large file's samples may be stored once they are encoded; None: in memory.
        """

    @abstractmethod
    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> eqx.Module:
        """An untrained field."""

    @abstractmethod
    def load(self, path: StrPath | None = None) -> Field:
        """The field of a weights file and its card, or the shipped one; raises `InputError` if they are of another task."""
