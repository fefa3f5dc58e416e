"""A task's training run: reads demonstrations, writes weights with their card."""

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
    """Trains a field, resumes a killed run or extends a finished one; writes `field.safetensors` and `field.json`.

    Args:
        model: Model of the task.
        data: Folder with `training.jsonl` and `validation.jsonl`.
        out: Folder of the run, as for `deggflow.train.train`.
        config: Settings; more steps than those of a finished run extend it.
        architecture: Sizes of the field by name, if the task has any.
        on_progress: Called at each point of the curves.
        commands: Makes the commands that train these weights again, for the card; None omits them.

    Raises:
        InputError: The data are invalid, `out` holds a run on other data or of another field, or another process is
            training it.
    """
    data, out = Path(data), Path(out)
    recipe = _recipe(model, data)  # read before hours of training, as it may be damaged
    sizes = dict(architecture)
    dataset = model.load_data(data / "training.jsonl", data / "validation.jsonl")
    if dataset.training.mask.shape[1] != dataset.validation.mask.shape[1]:
        raise InputError(f"training and validation {model.noun} differ in size", file=data)
    field = model.build(jax.random.key(config.seed), dataset, sizes)
    trained_field, curves = train(
        field,
        dataset.training,
        dataset.validation,
        config,
        out,
        # A run with another architecture is refused by the names of sizes, not of arrays.
        identity={"architecture": sizes} if sizes else None,
        loss=dataset.loss,
        augment=dataset.augment,
        on_progress=on_progress,
    )
    segments = run_segments(out)
    card = {
        "task": model.task,
        **({"architecture": sizes} if sizes else {}),
        "parameters": sum(
            leaf.size for leaf in jax.tree.leaves(eqx.filter(trained_field, eqx.is_array))
        ),
        "data": {**recipe, **dataset.remarks},
        "training": asdict(config) | ({"segments": segments} if segments[1:] else {}),
        **_commands(commands, recipe, config, segments),
        "loss": model.loss_text,
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
        **dataset.card,
    }
    save_weights(out / "field.safetensors", trained_field, card)
    return trained_field


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
