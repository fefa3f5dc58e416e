"""The commands that train weights again; the card of the weights records them."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from deggflow.task import Recipe
from deggflow.train import Remake, TrainingConfig


def remake(task: str, recipe_kind: type[Recipe], architecture: Mapping[str, int]) -> Remake:
    """Commands that make a task's demonstrations and train its field.

    Args:
        task: Name of the task.
        recipe_kind: Dataclass of its `data` options.
        architecture: Sizes of the network by name, if the user can choose them.
    """
    options = [field.name for field in fields(recipe_kind)]

    def commands(
        recipe: Mapping[str, Any], config: TrainingConfig, segments: Sequence[int]
    ) -> list[str]:
        training = {
            "batch": config.batch,
            "learning_rate": config.learning_rate,
            "seed": config.seed,
            **architecture,
        }
        data = {name: recipe[name] for name in options if name in recipe}
        return [
            f"deggflow {task} data --out data {_words(data)}",
            *(
                f"deggflow {task} train --data data --out run --steps {steps} {_words(training)}"
                for steps in segments
            ),
        ]

    return commands


def _words(options: Mapping[str, Any]) -> str:
    return " ".join(f"--{name.replace('_', '-')} {_value(each)}" for name, each in options.items())


def _value(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
