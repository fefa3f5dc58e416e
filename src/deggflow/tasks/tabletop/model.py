"""The tabletop's model: relaxed scenes, and a message-passing field that is trained on them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxtyping import PRNGKeyArray

from deggflow.field import MessagePassingField
from deggflow.files import StrPath
from deggflow.tables import is_table
from deggflow.task import AbstractModel, Recipe, TrainingData
from deggflow.train import Dataset, StoredDataset

from .data import CHUNK, load_dataset, make_scenes, stored_dataset
from .field import SHIPPED, build_field, load_field
from .library import MAX_OBJECTS
from .options import SceneRecipe
from .symmetry import random_symmetry


class TabletopModel(AbstractModel):
    """Scenes from a relaxation; L_MAC under the table's four symmetries."""

    task = "tabletop"
    noun = "scenes"
    sizes = (1, MAX_OBJECTS)
    chunk = CHUNK
    shipped = SHIPPED
    loss_text = (
        "L_MAC, tau ~ Unif[0, 1], z(0) ~ N(0, I), the table's four symmetries drawn at random"
    )

    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> list[dict[str, Any]]:
        """Scenes that satisfy the default requirements with room to spare."""
        assert isinstance(recipe, SceneRecipe)
        return [scene.to_json() for scene in make_scenes(size, first, count, recipe, seed)]

    def describe(self, folder: Path) -> Sequence[str]:
        """No lines: scenes are of one kind."""
        return ()

    def load_data(
        self, training: Path, validation: Path, scratch: Path | None = None
    ) -> TrainingData:
        """Encoded poses; those of a training table are stored in `scratch`."""
        data: Dataset | StoredDataset
        if scratch is None or not is_table(training):
            data = load_dataset(training)
        else:
            data = stored_dataset(training, scratch / "training.records")
        return TrainingData(data, load_dataset(validation), augment=random_symmetry)

    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> MessagePassingField:
        """An untrained field of the given sizes."""
        return build_field(key, **architecture)

    def load(self, path: StrPath | None = None) -> MessagePassingField:
        """As `load_field`."""
        return load_field(path)
