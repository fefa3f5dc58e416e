"""The tabletop field's training run: data in, weights with their card out."""

import json
import shlex
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import equinox as eqx
import jax

from deggflow.jsonl import InputError
from deggflow.train import Curve, TrainingConfig, train
from deggflow.weights import save_weights

from .data import load_dataset
from .field import build_field
from .symmetry import random_symmetry


def train_field(
    data: Path,
    out: Path,
    config: TrainingConfig,
    architecture: dict[str, int],
    on_progress: Callable[[Curve], None] = lambda curve: None,
) -> eqx.Module:
    """Trains, or completes a killed run, and writes `field.safetensors` with its card `field.json`."""
    training = load_dataset(data / "training.jsonl")
    validation = load_dataset(data / "validation.jsonl")
    if training.mask.shape[1] != validation.mask.shape[1]:
        raise InputError("training and validation scenes differ in size", file=data)
    field = build_field(jax.random.key(config.seed), **architecture)
    # A folder holds one run: the same size of field on the same data.
    identity = {"architecture": architecture, "data": _recipe(data)}
    trained, curves = train(
        field,
        training,
        validation,
        config,
        out,
        identity=identity,
        augment=random_symmetry,
        on_progress=on_progress,
    )
    command = (
        f"deggflow tabletop train --data {shlex.quote(data.name)} --out {shlex.quote(out.name)} "
        f"--steps {config.steps} --batch {config.batch} --learning-rate {config.learning_rate} "
        f"--seed {config.seed} "
    ) + " ".join(f"--{name.replace('_', '-')} {value}" for name, value in architecture.items())
    card = {
        "task": "tabletop",
        "architecture": architecture,
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(trained, eqx.is_array))),
        "data": identity["data"],
        "training": asdict(config),
        "command": command,
        "loss": "L_MAC, tau ~ Unif[0, 1], z(0) ~ N(0, I), the table's four symmetries drawn at random",
        "figures": {"training_loss": curves[-1].training, "validation_loss": curves[-1].validation},
    }
    save_weights(out / "field.safetensors", trained, card)
    return trained


def _recipe(data: Path) -> dict[str, object]:
    path = data / "training.jsonl.run.json"
    try:
        recipe: dict[str, object] = json.loads(path.read_text())
    except (OSError, ValueError):
        return {"source": "scenes not made by `deggflow tabletop data`"}
    return recipe
