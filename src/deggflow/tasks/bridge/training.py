"""The bridge field's training run: demonstrations in, weights with their card out."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.files import StrPath
from deggflow.flow import Field, LinearPath
from deggflow.jsonl import InputError
from deggflow.output import run_settings
from deggflow.train import Curve, Remake, TrainingConfig, run_segments, train
from deggflow.weights import save_weights

from .codec import decode_twists
from .condition import Scales
from .data import Example, load_dataset
from .field import BridgeField
from .motion import contact_velocity
from .world import EXECUTED, HORIZON

MOTION_WEIGHT, TWIST_WEIGHT = 0.16, 0.45
EXECUTED_WEIGHT = 2.5  # rho_t of the actions that are executed; 1 for the rest


def training_loss(scales: Scales) -> Callable[..., Float[Array, ""]]:
    """L_MAC + 0.16 L_motion + 0.45 L_twist, one sample (paper, App. on Task 1)."""
    rho = jnp.where(jnp.arange(HORIZON) < EXECUTED, EXECUTED_WEIGHT, 1.0)
    sigma_c, sigma_xi = jnp.array(scales.contact), jnp.array(scales.twist)

    def loss(
        field: Field,
        tau: Float[Array, ""],
        x0: Float[Array, "agents dim"],
        x1: Float[Array, "agents dim"],
        example: Example,
        mask: Bool[Array, " agents"],
    ) -> Float[Array, ""]:
        condition, present = example.condition, jnp.sum(mask)
        x, velocity = LinearPath().sample(tau, x0, x1)
        found = field(tau, x, condition)
        square = jnp.sum((found - velocity) ** 2, axis=-1)
        mac = jnp.sum(jnp.where(mask, square, 0.0)) / present
        end = x + (1 - tau) * found  # the estimated endpoint
        error = decode_twists(end, condition, scales) - example.twists
        twist = jnp.sum(rho[:, None] * (error / sigma_xi[None]) ** 2) / (3 * jnp.sum(rho))
        slip = contact_velocity(error[None], condition.contacts[:, None]) / sigma_c[None, None]
        each = jnp.sum(rho[None, :, None] * slip**2, axis=(1, 2))
        motion = jnp.sum(jnp.where(mask, each, 0.0)) / (2 * present * jnp.sum(rho))
        return mac + MOTION_WEIGHT * motion + TWIST_WEIGHT * twist

    return loss


def train_field(
    data: StrPath,
    out: StrPath,
    config: TrainingConfig,
    on_progress: Callable[[Curve], None] = lambda curve: None,
    *,
    commands: Remake | None = None,
) -> eqx.Module:
    """Trains, completes a killed run or extends a finished one; writes `field.safetensors` and its card `field.json`.

    Args:
        data: Folder with `training.jsonl` and `validation.jsonl`.
        out: Folder of the run, as `deggflow.train.train` keeps it.
        config: Settings; more steps than a finished run has extend it.
        on_progress: Called at each point of the curves.
        commands: What the card says of how to train these weights again; nothing if None.

    Raises:
        InputError: The data are not as they should be, or `out` holds a run on other data.
    """
    data, out = Path(data), Path(out)
    recipe = _recipe(data)  # before hours of training: it may be damaged
    training, scales = load_dataset(data / "training.jsonl", None, perturb=True)
    validation, _ = load_dataset(data / "validation.jsonl", scales, perturb=True)
    if training.mask.shape[1] != validation.mask.shape[1]:
        raise InputError("training and validation trials differ in size", file=data)
    field = BridgeField(scales, key=jax.random.key(config.seed))
    trained, curves = train(
        field,
        training,
        validation,
        config,
        out,
        loss=training_loss(scales),
        on_progress=on_progress,
    )
    segments = run_segments(out)
    card = {
        "task": "bridge",
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(trained, eqx.is_array))),
        "data": {**recipe, "windows": len(training.mask)},
        "training": asdict(config) | ({"segments": segments} if segments[1:] else {}),
        **({} if commands is None else {"commands": commands(recipe, config, segments)}),
        "loss": "L_MAC + 0.16 L_motion + 0.45 L_twist, tau ~ Unif[0, 1], z(0) ~ N(0, I)",
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
        "scales": scales._asdict(),
    }
    save_weights(out / "field.safetensors", trained, card)
    return trained


def _recipe(data: Path) -> dict[str, Any]:
    made = run_settings(data / "training.jsonl")
    return {"source": "demonstrations not made by `deggflow bridge data`"} if made is None else made
