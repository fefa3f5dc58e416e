"""`--retrain`: every seed of both tasks trained again, as the cards of the shipped weights say."""

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

QUICK_STEPS, QUICK_POINTS = 100, 5  # it works, and no more than that
QUICK_TRAINING, QUICK_VALIDATION = 64, 16  # scenes or demonstrations of each size

Shown = Callable[[Curve], None]


class Plan(NamedTuple):
    """What one task is trained with."""

    recipe: dict[str, Any]  # of its data
    config: TrainingConfig
    architecture: dict[str, int]  # tabletop only


def plan(card: dict[str, Any], *, quick: bool) -> Plan:
    """The card's settings; in quick, few steps on little data."""
    known = {field.name for field in fields(TrainingConfig)}
    config = TrainingConfig(**{k: v for k, v in card["training"].items() if k in known})
    recipe = dict(card["data"])
    if quick:
        recipe |= {"training": QUICK_TRAINING, "validation": QUICK_VALIDATION}
        points = QUICK_STEPS // QUICK_POINTS
        config = replace(config, steps=QUICK_STEPS, validate_every=points, batch=32)
    return Plan(recipe, config, card.get("architecture", {}))


def retrain(weights: dict[str, Path], out: Path, *, quick: bool, say: Progress) -> Sources:
    """Trains all seeds of both tasks, or goes on where a stopped call was; returns where their curves are.

    Args:
        weights: The shipped weights of each task; the cards beside them say how to train.
        out: Receives data in `<task>-data` and runs in `<task>-seed<k>`.
        quick: Few steps on little data.
        say: Told what is being done.
    """
    found: dict[str, dict[int, Path]] = {}
    for task in TASKS:
        entry = next(entry for entry in SHIPPED if entry.name == task)
        model, recipe_kind = entry.load_task().model, entry.load_options().data
        wanted, data = plan(load_card(weights[task]), quick=quick), out / f"{task}-data"
        say(f"{task}: data")
        recipe = parse_as(recipe_kind, {f.name: wanted.recipe[f.name] for f in fields(recipe_kind)})
        write_data(model, data, recipe, _told(say, f"{task}: data"))
        commands = remake(task, recipe_kind, wanted.architecture)
        found[task] = {}
        for seed in range(TRAINING_SEEDS):
            run = out / f"{task}-seed{seed}"
            config = replace(wanted.config, seed=seed)
            train_field(
                model, data, run, config, wanted.architecture, _shown(say, task, config),
                commands=commands,
            )  # fmt: skip
            found[task][seed] = run / "curves.csv"
    return found


def _told(say: Progress, what: str) -> Callable[[int, int], None]:
    return lambda done, total: say(f"{what}, {done:,} of {total:,}")


def _shown(say: Progress, task: str, config: TrainingConfig) -> Shown:
    def show(curve: Curve) -> None:
        losses = f"loss {curve.training:.4f}, validation {curve.validation:.4f}"
        say(f"{task}, seed {config.seed}: step {curve.step:,} of {config.steps:,}, {losses}")

    return show
