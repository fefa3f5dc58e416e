"""The tabletop field's training run: data in, weights with their card out."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import equinox as eqx
import jax

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import run_settings
from deggflow.train import Curve, Remake, TrainingConfig, run_segments, train
from deggflow.weights import save_weights

from .data import load_dataset
from .field import build_field
from .symmetry import random_symmetry


def train_field(
    data: StrPath,
    out: StrPath,
    config: TrainingConfig,
    architecture: dict[str, int],
    on_progress: Callable[[Curve], None] = lambda curve: None,
    *,
    commands: Remake | None = None,
) -> eqx.Module:
    """Trains, completes a killed run or extends a finished one; writes `field.safetensors` and its card `field.json`.

    Args:
        data: Folder with `training.jsonl` and `validation.jsonl`.
        out: Folder of the run, as `deggflow.train.train` keeps it.
        config: Settings; more steps than a finished run has extend it.
        architecture: `width`, `rounds` and `head_width` of the field.
        on_progress: Called at each point of the curves.
        commands: What the card says of how to train these weights again; nothing if None.

    Raises:
        InputError: The data are not as they should be, or `out` holds a run on other data or of another field.
    """
    data, out = Path(data), Path(out)
    recipe = _recipe(data)  # before hours of training: it may be damaged
    training = load_dataset(data / "training.jsonl")
    validation = load_dataset(data / "validation.jsonl")
    if training.mask.shape[1] != validation.mask.shape[1]:
        raise InputError("training and validation scenes differ in size", file=data)
    field = build_field(jax.random.key(config.seed), **architecture)
    trained, curves = train(
        field,
        training,
        validation,
        config,
        out,
        identity={"architecture": architecture},  # refused by these names, not by those of arrays
        augment=random_symmetry,
        on_progress=on_progress,
    )
    segments = run_segments(out)
    card = {
        "task": "tabletop",
        "architecture": architecture,
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(trained, eqx.is_array))),
        "data": recipe,
        "training": asdict(config) | ({"segments": segments} if segments[1:] else {}),
        **({} if commands is None else {"commands": commands(recipe, config, segments)}),
        "loss": "L_MAC, tau ~ Unif[0, 1], z(0) ~ N(0, I), the table's four symmetries drawn at random",
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
    }
    save_weights(out / "field.safetensors", trained, card)
    return trained


def _recipe(data: Path) -> dict[str, Any]:
    made = run_settings(data / "training.jsonl")
    return {"source": "scenes not made by `deggflow tabletop data`"} if made is None else made
