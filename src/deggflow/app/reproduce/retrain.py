"""`--retrain`: trains every seed of both tasks again, with the settings in the cards of the shipped weights."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from deggflow.app.registry import SHIPPED
from deggflow.app.remake import remake
from deggflow.schema import parse_as
from deggflow.task import train_field, write_data
from deggflow.train import Curve, TrainingConfig
from deggflow.weights import load_card

from .curves import TASKS, Sources
from .experiment import Progress
from .paper import TRAINING_SEEDS

QUICK_STEPS, QUICK_POINTS = 100, 5  # only checks that training works
QUICK_TRAINING, QUICK_VALIDATION = 64, 16  # scenes or demonstrations of each size


class Plan(NamedTuple):
    """Training settings of one task.

    Attributes:
        recipe: Recipe of its data.
        config: Training configuration.
        architecture: Sizes of the network by name; empty if the task fixes them.
    """

    recipe: dict[str, Any]
    config: TrainingConfig
    architecture: dict[str, int]


def plan(card: dict[str, Any], *, quick: bool) -> Plan:
    """The settings of a card; for a quick run, few steps on little data."""
    names = {field.name for field in fields(TrainingConfig)}
    config = TrainingConfig(**{k: v for k, v in card["training"].items() if k in names})
    recipe = dict(card["data"])
    if quick:
        recipe |= {"training": QUICK_TRAINING, "validation": QUICK_VALIDATION}
        points = QUICK_STEPS // QUICK_POINTS
        config = replace(config, steps=QUICK_STEPS, validate_every=points, batch=32)
    return Plan(recipe, config, card.get("architecture", {}))


def retrain(weights: dict[str, Path], out: Path, *, quick: bool, say: Progress) -> Sources:
    """Trains all seeds of both tasks, resuming an interrupted call; returns the files of their curves.

    Args:
        weights: The shipped weights of each task; the cards beside them hold the settings.
        out: Folder that receives data in `<task>-data` and runs in `<task>-seed<k>`.
        quick: Whether to take few steps on little data.
        say: Called with the current activity.
    """
    curves: dict[str, dict[int, Path]] = {}
    for task in TASKS:
        entry = next(entry for entry in SHIPPED if entry.name == task)
        model, recipe_kind = entry.load_task().model, entry.load_options().data
        settings, data = plan(load_card(weights[task]), quick=quick), out / f"{task}-data"
        say(f"{task}: data")
        recipe = parse_as(
            recipe_kind, {f.name: settings.recipe[f.name] for f in fields(recipe_kind)}
        )
        write_data(model, data, recipe, _data_progress(say, f"{task}: data"))
        commands = remake(task, recipe_kind, settings.architecture)
        curves[task] = {}
        for seed in range(TRAINING_SEEDS):
            run = out / f"{task}-seed{seed}"
            config = replace(settings.config, seed=seed)
            train_field(
                model, data, run, config, settings.architecture, _training_progress(say, task, config),
                commands=commands,
            )  # fmt: skip
            curves[task][seed] = run / "curves.csv"
    return curves


def _data_progress(say: Progress, what: str) -> Callable[[int, int], None]:
    return lambda count, total: say(f"{what}, {count:,} of {total:,}")


def _training_progress(say: Progress, task: str, config: TrainingConfig) -> Callable[[Curve], None]:
    def show(curve: Curve) -> None:
        losses = f"loss {curve.training:.4f}, validation {curve.validation:.4f}"
        say(f"{task}, seed {config.seed}: step {curve.step:,} of {config.steps:,}, {losses}")

    return show
