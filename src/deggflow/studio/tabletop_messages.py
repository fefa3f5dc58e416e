"""What a page may ask of the tabletop, and how it is checked."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from deggflow.jsonl import InputError, expect_list, expect_number
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.formats import parse_condition
from deggflow.tasks.tabletop.large import is_large
from deggflow.tasks.tabletop.library import MAX_OBJECTS
from deggflow.tasks.tabletop.verdict import Poses

from .messages import AbstractWrite

MAX_POSE = 1e6  # m or rad, as in files


@dataclass(frozen=True)
class Generate:
    """A scene is asked for.

    Attributes:
        condition: As in a file.
        seed: As of the command.
        max_draws: As of the command.
        draw: Number from 0 of the only draw to make; None: the first that is satisfied, as the command.
    """

    condition: Any
    seed: int
    max_draws: int
    draw: int | None


@dataclass(frozen=True)
class Replay:
    """The generation of one draw is asked for.

    Attributes:
        condition: As in a file.
        seed: Of the scene.
        draw: Number from 0.
        poses: Of the scene, which the replay ends at.
    """

    condition: Any
    seed: int
    draw: int
    poses: Any


@dataclass(frozen=True)
class Judge:
    """A verdict on poses is asked for.

    Attributes:
        condition: As in a file.
        poses: x, y (m) and theta (rad) of each object.
    """

    condition: Any
    poses: Any


@dataclass(frozen=True)
class Claim(Judge):
    """A line is asked for that says what is true of poses set by hand.

    Attributes:
        seed: Of the scene that the poses were changed from.
    """

    seed: int


@dataclass(frozen=True)
class Draw:
    """Random objects and requirements are asked for.

    Attributes:
        size: Number of objects.
        family: As --requirements of the command.
        seed: As of the command.
    """

    size: int
    family: str
    seed: int


@dataclass(frozen=True)
class Write(AbstractWrite):
    """A file of a scene is asked for.

    Attributes:
        condition: As in a file.
        poses: x, y (m) and theta (rad) of each object.
    """

    condition: Any
    poses: Any


def studio_condition(value: Any, field: str = "condition") -> SceneCondition:
    """A condition of the page.

    Raises:
        InputError: It is invalid, or one of a large scene.
    """
    condition = parse_condition(value, field)
    if is_large(condition):
        raise InputError(
            f"the studio shows up to {MAX_OBJECTS} objects of different types; `deggflow tabletop` makes large scenes",
            field=f"{field}.objects".lstrip("."),
        )
    return condition


def checked_scene(request: Judge | Replay | Write) -> tuple[SceneCondition, Poses]:
    """Condition and poses of a page's message.

    Raises:
        InputError: As of `studio_condition` and `parse_poses`.
    """
    condition = studio_condition(request.condition)
    return condition, parse_poses(request.poses, condition)


def parse_poses(value: Any, condition: SceneCondition) -> Poses:
    """Poses of the page's message, in the condition's order.

    Raises:
        InputError: They are not three numbers for each object.
    """
    rows = expect_list(value, "poses")
    if len(rows) != len(condition.objects):
        raise InputError(
            f"must hold {len(condition.objects)} poses, one for each object; got {len(rows)}",
            field="poses",
        )
    out = []
    for k, row in enumerate(rows):
        numbers = expect_list(row, f"poses[{k}]")
        if len(numbers) != 3:
            raise InputError(f"must hold x, y and theta; got {len(numbers)}", field=f"poses[{k}]")
        out.append(
            [
                expect_number(each, f"poses[{k}][{j}]", -MAX_POSE, MAX_POSE, "")
                for j, each in enumerate(numbers)
            ]
        )
    return np.array(out, np.float64)
