"""What a user types to train weights again; it stands in their card."""

from collections.abc import Mapping, Sequence
from typing import Any

from deggflow.train import Remake, TrainingConfig


def bridge_commands(
    recipe: Mapping[str, Any], config: TrainingConfig, segments: Sequence[int]
) -> list[str]:
    """Commands that make the bridge's demonstrations and train its field; `segments` as `run_segments`."""
    made_by = ("training", "validation", "seed")
    return _commands("bridge", made_by, recipe, _of_training(config), segments)


def tabletop_commands(architecture: Mapping[str, int]) -> Remake:
    """The same of the tabletop, whose field has sizes."""

    def commands(
        recipe: Mapping[str, Any], config: TrainingConfig, segments: Sequence[int]
    ) -> list[str]:
        made_by = ("training", "validation", "clearance", "seed")
        options = {**_of_training(config), **architecture}
        return _commands("tabletop", made_by, recipe, options, segments)

    return commands


def _of_training(config: TrainingConfig) -> dict[str, Any]:
    return {
        "batch": config.batch,
        "learning_rate": config.learning_rate,
        "seed": config.seed,
    }


def _commands(
    task: str,
    made_by: Sequence[str],
    recipe: Mapping[str, Any],
    options: Mapping[str, Any],
    segments: Sequence[int],
) -> list[str]:
    data = {name: recipe[name] for name in made_by if name in recipe}
    return [
        f"deggflow {task} data --out data {_words(data)}",
        *(
            f"deggflow {task} train --data data --out run --steps {steps} {_words(options)}"
            for steps in segments
        ),
    ]


def _words(options: Mapping[str, Any]) -> str:
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in options.items())
