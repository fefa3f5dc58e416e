"""A task's training run: reads demonstrations, writes weights with their card."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import equinox as eqx
import jax

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import run_settings
from deggflow.tables import is_table, read_info
from deggflow.train import (
    Curve,
    Dataset,
    Remake,
    StoredDataset,
    TrainingConfig,
    run_segments,
    train,
)
from deggflow.weights import save_weights

from .model import AbstractModel


class DataFiles(NamedTuple):
    """Files of demonstrations, JSON Lines or tables.

    Attributes:
        training: Training demonstrations.
        validation: Validation demonstrations.
    """

    training: Path
    validation: Path


def data_files(data: StrPath, validation: StrPath | None = None) -> DataFiles:
    """The files to train on.

    Args:
        data: A folder with training.jsonl and validation.jsonl, or with training.parquet and validation.parquet; or a file.
        validation: The other file, if `data` is one.

    Raises:
        InputError: One of two files is missing, or too many are named.

    Example:
        >>> data_files("data").training.name
        'training.jsonl'
    """
    data = Path(data)
    if not data.is_dir() and data.suffix in (".jsonl", ".parquet"):
        if validation is None:
            raise InputError("--validation FILE goes with a file as --data", file=data)
        return DataFiles(data, Path(validation))
    if validation is not None:
        raise InputError("--validation goes with a file as --data, not with a folder", file=data)
    tables = DataFiles(data / "training.parquet", data / "validation.parquet")
    lines = DataFiles(data / "training.jsonl", data / "validation.jsonl")
    return tables if tables.training.exists() and not lines.training.exists() else lines


def train_field(
    model: AbstractModel,
    data: StrPath | DataFiles,
    out: StrPath,
    config: TrainingConfig,
    architecture: Mapping[str, int] = MappingProxyType({}),
    on_progress: Callable[[Curve], None] = lambda curve: None,
    *,
    commands: Remake | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> eqx.Module:
    """Trains a field, resumes a killed run or extends a finished one; writes `field.safetensors` and `field.json`.

    Args:
        model: Model of the task.
        data: As for `data_files`.
        out: Folder of the run, as for `deggflow.train.train`.
        config: Settings; more steps than those of a finished run extend it.
        architecture: Sizes of the field by name, if the task has any.
        on_progress: Called at each point of the curves.
        commands: Makes the commands that train these weights again, for the card; None omits them.
        devices: As for `deggflow.train.train`.

    Raises:
        InputError: The data are invalid, `out` holds a run on other data or of another field, or another process is
            training it.
    """
    files = data if isinstance(data, DataFiles) else data_files(data)
    out = Path(out)
    recipe = _recipe(model, files)  # read before hours of training, as it may be damaged
    sizes = dict(architecture)
    dataset = model.load_data(*files, out / "encoded")
    if _agents(dataset.training) != _agents(dataset.validation):
        raise InputError(f"training and validation {model.noun} differ in size", file=files[0])
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
        devices=devices,
    )
    if jax.process_index():
        return trained_field
    segments = run_segments(out)
    card = {
        "task": model.task,
        **({"architecture": sizes} if sizes else {}),
        "parameters": _parameters(trained_field),
        "data": {**recipe, **dataset.remarks},
        "training": asdict(config) | ({"segments": segments} if segments[1:] else {}),
        **_commands(commands, recipe, config, segments),
        "loss": model.loss_text,
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
        **dataset.card,
    }
    save_weights(out / "field.safetensors", trained_field, card)
    return trained_field


def _agents(data: Dataset | StoredDataset) -> int:
    shapes = data.structure if isinstance(data, StoredDataset) else data
    return int(shapes.mask.shape[1])


def _parameters(field: eqx.Module) -> int:
    return sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(field, eqx.is_array)))


def _recipe(model: AbstractModel, files: DataFiles) -> dict[str, Any]:
    if is_table(files.training):
        recipe = read_info(files.training).about.get("run")
        recipe = dict(recipe) if isinstance(recipe, dict) and recipe else None
    else:
        recipe = run_settings(files.training)
    foreign = f"{model.noun} not made by `deggflow {model.task} data`"
    return {"source": foreign} if recipe is None else recipe


def _commands(
    commands: Remake | None,
    recipe: Mapping[str, Any],
    config: TrainingConfig,
    segments: Sequence[int],
) -> dict[str, list[str]]:
    return {} if commands is None else {"commands": commands(recipe, config, segments)}
