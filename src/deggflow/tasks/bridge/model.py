"""The bridge's model: demonstrations of an expert, and the paper's field that is trained on their windows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, PRNGKeyArray

from deggflow.files import StrPath
from deggflow.flow import Field, LinearPath
from deggflow.shapes import Scalar, States
from deggflow.task import AbstractModel, Recipe, TrainingData
from deggflow.train import SampleLoss

from .codec import decode_twists
from .condition import Scales
from .data import Example, approaches, load_dataset, to_json
from .expert import random_demonstration
from .field import SHIPPED, BridgeField, load_field
from .motion import contact_velocity
from .world import EXECUTED, HORIZON, MAX_ROBOTS, MIN_ROBOTS

MOTION_WEIGHT, TWIST_WEIGHT = 0.16, 0.45
EXECUTED_WEIGHT = 2.5  # rho_t of the actions that are executed; 1 for the rest


def training_loss(scales: Scales) -> SampleLoss:
    """L_MAC + 0.16 L_motion + 0.45 L_twist, one sample (paper, App. on Task 1)."""
    rho = jnp.where(jnp.arange(HORIZON) < EXECUTED, EXECUTED_WEIGHT, 1.0)
    sigma_c, sigma_xi = jnp.array(scales.contact), jnp.array(scales.twist)

    def loss(
        field: Field,
        tau: Scalar,
        x0: States,
        x1: States,
        example: Example,
        mask: Bool[Array, " agents"],
    ) -> Scalar:
        condition, present = example.condition, jnp.sum(mask)
        x, velocity = LinearPath().sample(tau, x0, x1)
        prediction = field(tau, x, condition)
        square = jnp.sum((prediction - velocity) ** 2, axis=-1)
        mac = jnp.sum(jnp.where(mask, square, 0.0)) / present
        end = x + (1 - tau) * prediction  # the estimated endpoint
        error = decode_twists(end, condition, scales) - example.twists
        twist = jnp.sum(rho[:, None] * (error / sigma_xi[None]) ** 2) / (3 * jnp.sum(rho))
        slip = contact_velocity(error[None], condition.contacts[:, None]) / sigma_c[None, None]
        each = jnp.sum(rho[None, :, None] * slip**2, axis=(1, 2))
        motion = jnp.sum(jnp.where(mask, each, 0.0)) / (2 * present * jnp.sum(rho))
        return mac + MOTION_WEIGHT * motion + TWIST_WEIGHT * twist

    return loss


class BridgeModel(AbstractModel):
    """Demonstrations of a randomised expert; the paper's network and loss."""

    task = "bridge"
    noun = "demonstrations"
    sizes = (MIN_ROBOTS, MAX_ROBOTS)
    chunk = 256
    shipped = SHIPPED
    loss_text = "L_MAC + 0.16 L_motion + 0.45 L_twist, tau ~ Unif[0, 1], z(0) ~ N(0, I)"

    def demonstrate(
        self, size: int, first: int, count: int, recipe: Recipe, seed: int
    ) -> list[dict[str, Any]]:
        """Demonstrations from random starts to random goals."""
        numbers = range(first, first + count)
        return [to_json(random_demonstration(size, seed, number)) for number in numbers]

    def describe(self, folder: Path) -> list[str]:
        """How often each approach occurs."""
        return [
            f"{approach}: {rate} of the training demonstrations"
            for approach, rate in approaches(folder / "training.jsonl").items()
        ]

    def load_data(
        self, training: Path, validation: Path, scratch: Path | None = None
    ) -> TrainingData:
        """Windows of demonstrations, scaled by the statistics of the training set."""
        windows, scales = load_dataset(training, None, perturb=True)
        held_out, _ = load_dataset(validation, scales, perturb=True)
        return TrainingData(
            windows,
            held_out,
            loss=training_loss(scales),
            statistics=scales,
            remarks={"windows": len(windows.mask)},
            card={"scales": scales._asdict()},
        )

    def build(
        self, key: PRNGKeyArray, data: TrainingData, architecture: Mapping[str, int]
    ) -> BridgeField:
        """An untrained field with the scales of the training set."""
        return BridgeField(data.statistics, key=key)

    def load(self, path: StrPath | None = None) -> BridgeField:
        """As `load_field`."""
        return load_field(path)
