"""The fleet's model: planned demonstrations, and a message-passing field over paths that is trained on them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, PRNGKeyArray

from deggflow.files import StrPath
from deggflow.flow import Field, LinearPath
from deggflow.shapes import Scalar, States
from deggflow.task import AbstractModel, Recipe, TrainingData

from .condition import MAX_ROBOTS, MIN_ROBOTS, FleetArrays
from .data import conflict_free, load_dataset, make_demonstrations, read_demonstrations, spread
from .field import ACTIVE, FleetField, load_field

# Slow modes move whole parts of a path and count more: weight 1 / (k + 1) of mode k, of the active ones.
WEIGHTS = np.repeat(1 / (np.arange(ACTIVE) + 1.0), 2)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


def path_loss(
    field: Field,
    tau: Scalar,
    x0: States,
    x1: States,
    condition: FleetArrays,
    mask: Bool[Array, " agents"],
) -> Scalar:
    """L_MAC with weights of the modes, one sample."""
    x, velocity = LinearPath().sample(tau, x0, x1)
    error = (field(tau, x, condition) - velocity)[:, : len(WEIGHTS)]
    square = error**2 @ jnp.asarray(WEIGHTS, error.dtype)
    return jnp.sum(jnp.where(mask, square, 0.0)) / jnp.sum(mask)


class FleetModel(AbstractModel):
    """Demonstrations of a planner; L_MAC with more weight on slow modes."""

    task = "fleet"
    noun = "demonstrations"
    sizes = (MIN_ROBOTS, MAX_ROBOTS)
    chunk = 64
    loss_text = "L_MAC with weights proportional to 1/(k + 1) of mode k, k < 24; tau ~ Unif[0, 1], z(0) ~ N(0, I)"

    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> list[dict[str, Any]]:
        """Planned paths of drawn conditions."""
        return [each.to_json() for each in make_demonstrations(size, first, count, seed)]

    def describe(self, folder: Path) -> Sequence[str]:
        """How many demonstrations of each map keep their robots apart."""
        made = read_demonstrations(folder / "training.jsonl")
        return [
            f"{name}: robots keep apart in {rate} of the training demonstrations"
            for name, rate in conflict_free(made).items()
        ]

    def load_data(
        self, training: Path, validation: Path, scratch: Path | None = None
    ) -> TrainingData:
        """Encoded paths, and the spread of their modes."""
        data, held_out = load_dataset(training), load_dataset(validation)
        of_modes = spread(data)
        return TrainingData(
            data, held_out, loss=path_loss, statistics=of_modes, card={"spread": list(of_modes)}
        )

    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> FleetField:
        """An untrained field of the given sizes, scaled by the spread of the training set."""
        return FleetField(data.statistics, key=key, **architecture)

    def load(self, path: StrPath | None = None) -> FleetField:
        """As `load_field`."""
        return load_field(path)
