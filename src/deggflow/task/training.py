"""A task's training run: demonstrations in, weights with their card out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import run_settings
from deggflow.train import Curve, Remake, TrainingConfig, run_segments, train
from deggflow.weights import save_weights

from .model import AbstractModel


def train_field(
    model: AbstractModel,
    data: StrPath,
    out: StrPath,
    config: TrainingConfig,
    architecture: Mapping[str, int] = MappingProxyType({}),
    on_progress: Callable[[Curve], None] = lambda curve: None,
    *,
    commands: Remake | None = None,
) -> eqx.Module:
    """Trains, completes a killed run or extends a finished one; writes `field.safetensors` and its card `field.json`.

    Args:
        model: Of the task.
        data: Folder with `training.jsonl` and `validation.jsonl`.
        out: Folder of the run, as `deggflow.train.train` keeps it.
        config: Settings; more steps than a finished run has extend it.
        architecture: Sizes of the field by name, where the task lets them be chosen.
        on_progress: Called at each point of the curves.
        commands: What the card says of how to train these weights again; nothing if None.

    Raises:
        InputError: The data are not as they should be, or `out` holds a run on other data or of another field, or one
            that another process trains.
    """
    data, out = Path(data), Path(out)
    recipe = _recipe(model, data)  # before hours of training: it may be damaged
    sizes = dict(architecture)
    prepared = model.load_data(data / "training.jsonl", data / "validation.jsonl")
    if prepared.training.mask.shape[1] != prepared.validation.mask.shape[1]:
        raise InputError(f"training and validation {model.noun} differ in size", file=data)
    field = model.build(jax.random.key(config.seed), prepared, sizes)
    trained, curves = train(
        field,
        prepared.training,
        prepared.validation,
        config,
        out,
        # Refused by these names, not by those of arrays.
        identity={"architecture": sizes} if sizes else None,
        loss=prepared.loss,
        augment=prepared.augment,
        on_progress=on_progress,
    )
    segments = run_segments(out)
    card = {
        "task": model.task,
        **({"architecture": sizes} if sizes else {}),
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(trained, eqx.is_array))),
        "data": {**recipe, **prepared.remarks},
        "training": asdict(config) | ({"segments": segments} if segments[1:] else {}),
        **_commands(commands, recipe, config, segments),
        "loss": model.loss_text,
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
        **prepared.card,
    }
    save_weights(out / "field.safetensors", trained, card)
    return trained


def _recipe(model: AbstractModel, data: Path) -> dict[str, Any]:
    recipe = run_settings(data / "training.jsonl")
    foreign = f"{model.noun} not made by `deggflow {model.task} data`"
    return {"source": foreign} if recipe is None else recipe


def _commands(
    commands: Remake | None,
    recipe: Mapping[str, Any],
    config: TrainingConfig,
    segments: Sequence[int],
) -> dict[str, list[str]]:
    return {} if commands is None else {"commands": commands(recipe, config, segments)}
