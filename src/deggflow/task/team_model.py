"""The model of a team task: its demonstrations, and a message-passing field over its features."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from deggflow.field import MessagePassingField
from deggflow.files import StrPath
from deggflow.jsonl import InputError, expect_list, expect_number
from deggflow.train import Dataset
from deggflow.weights import expect_sizes, load_by_card

from .model import AbstractModel, TrainingData
from .options import Recipe
from .team_sample import TeamSample

if TYPE_CHECKING:
    from .team import AbstractTeamTask

LARGEST = {"width": 8192, "rounds": 64, "head_width": 8192}  # largest sizes that a card may have
_LEAST_SPREAD = 1e-3  # of a coordinate


class TeamModel(AbstractModel):
    """Demonstrations by the task's expert, a message-passing field, and the loss L_MAC."""

    chunk = 256
    loss_text = "L_MAC, tau ~ Unif[0, 1], z(0) ~ N(0, I)"

    def __init__(self, task: "AbstractTeamTask") -> None:
        """Args: task: the task of the model."""
        self._task = task
        self.task, self.noun, self.sizes = task.name, f"{task.noun}s", task.sizes
        self.shipped = task.weights

    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> Sequence[Mapping[str, Any]]:
        """Random conditions with the states that the task's expert draws for them."""
        rows = []
        for number in range(first, first + count):
            rng = np.random.default_rng([seed, size, number])
            condition = self._task.random_condition(size, rng)
            states = np.asarray(self._task.demonstrate(condition, rng), np.float64)
            rows.append(TeamSample(condition, states, seed).to_json())
        return rows

    def describe(self, folder: Path) -> Sequence[str]:
        """No lines."""
        return ()

    def load_data(
        self, training: Path, validation: Path, scratch: Path | None = None
    ) -> TrainingData:
        """Encodes the states and computes their spread in the training set."""
        data, held_out = self._dataset(training), self._dataset(validation)
        z, mask = np.asarray(data.z), np.asarray(data.mask)
        spread = np.maximum(z[mask].std(axis=0), _LEAST_SPREAD).astype(float).tolist()
        return TrainingData(data, held_out, statistics=tuple(spread), card={"spread": spread})

    def _dataset(self, path: Path) -> Dataset:
        samples = self._task.read_demonstrations(path)
        arrays, mask = self._task.stack([sample.condition for sample in samples])
        z = np.zeros((*mask.shape, self._task.dim), np.float32)
        for row, sample in zip(z, samples, strict=True):
            row[: len(sample.states)] = sample.states / self._task.scale
        return Dataset(jnp.asarray(z), arrays, jnp.asarray(mask))

    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> MessagePassingField:
        """An untrained field."""
        return self._field(key, data.statistics, architecture)

    def _field(
        self, key: PRNGKeyArray, spread: tuple[float, ...], architecture: Mapping[str, int]
    ) -> MessagePassingField:
        size = self._task.sizes[1]
        condition = self._task.random_condition(size, np.random.default_rng(0))
        arrays = self._task.arrays(condition, size)
        features = jax.eval_shape(self._task.features, jnp.zeros((size, self._task.dim)), arrays)
        return MessagePassingField(
            self._task.features,
            node_size=features.node.shape[-1],
            pair_size=features.pair.shape[-1],
            spread=spread,
            key=key,
            **architecture,
        )

    def load(self, path: StrPath | None = None) -> MessagePassingField:
        """The field of a weights file and its card; raises `InputError` if they are of another task."""
        path = self._task.weights if path is None else Path(path)
        if path is None:
            raise InputError(
                f"{self.task} has no default weights; give --weights FILE, a file that `train` wrote"
            )
        return load_by_card(path, self._skeleton)

    def _skeleton(self, card: Mapping[str, Any]) -> MessagePassingField:
        if card.get("task") != self.task:
            raise InputError(f"must be {self.task!r}; got {card.get('task')!r}", field="task")
        sizes = expect_sizes(card, LARGEST)
        entries = expect_list(card.get("spread"), "spread")
        spread = tuple(
            expect_number(each, f"spread[{k}]", _LEAST_SPREAD / 2, 1e6, "")
            for k, each in enumerate(entries)
        )
        if len(spread) != self._task.dim:
            raise InputError(
                f"must hold {self._task.dim} numbers; got {len(spread)}", field="spread"
            )
        return eqx.filter_eval_shape(lambda key: self._field(key, spread, sizes), jax.random.key(0))
