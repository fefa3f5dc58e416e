"""What a page may ask of the bridge."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from deggflow.jsonl import InputError, expect_integer, expect_number
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.formats import MAX_SEED, parse_condition
from deggflow.tasks.bridge.generator import MAX_DRAWS

from .messages import AbstractWrite


@dataclass(frozen=True)
class Random:
    """A random condition is asked for.

    Attributes:
        size: Number of robots.
        seed: As of the command.
    """

    size: int
    seed: int


@dataclass(frozen=True)
class Placed:
    """Whether a trial may begin and end so.

    Attributes:
        condition: As in a file.
    """

    condition: Any


@dataclass(frozen=True)
class Run:
    """A trial is asked for.

    Attributes:
        condition: As in a file.
        seed: As of the command.
        max_draws: As of the command.
        speed_limit: As of the command, m/s; None for none.
    """

    condition: Any
    seed: int
    max_draws: int
    speed_limit: float | None


@dataclass(frozen=True)
class PolicyCourse:
    """Both factors during the generation of one policy of a trial are asked for.

    Attributes:
        line: The trial as it stands in a file.
        number: Of the trial in its file, from 0.
        policy: Its number, from 0.
    """

    line: str
    number: int
    policy: int


@dataclass(frozen=True)
class Write(AbstractWrite):
    """A file of a trial is asked for.

    Attributes:
        line: The trial as it stands in a file.
    """

    line: str


class Settings(NamedTuple):
    """What decides a trial, checked; hashable.

    Attributes:
        condition: Of the trial.
        seed: As of the command.
        max_draws: As of the command.
        speed_limit: m/s; None for none.
    """

    condition: TrialCondition
    seed: int
    max_draws: int
    speed_limit: float | None


def settings(request: Run) -> Settings:
    """What a page asks for.

    Raises:
        InputError: Something is wrong; names the field.
    """
    limit = request.speed_limit
    if limit is not None:
        expect_number(limit, "speed_limit", 0.01, 10.0, "m/s")
    condition = parse_condition(request.condition, "condition")
    return Settings(
        TrialCondition(condition.plank, condition.goal, condition.contacts),
        expect_integer(request.seed, "seed", 0, MAX_SEED),
        expect_integer(request.max_draws, "max_draws", 1, MAX_DRAWS),
        limit,
    )


def number_of_policy(value: int, policies: int) -> int:
    """The number of one of a trial's policies.

    Raises:
        InputError: There is no such policy.
    """
    if not 0 <= value < policies:
        raise InputError(f"must be one of the trial's {policies} policies", field="policy")
    return value
