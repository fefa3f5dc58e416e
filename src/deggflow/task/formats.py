"""How a task's conditions and results stand in files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from deggflow.consistency import Unverified, Wrong, first_difference


@runtime_checkable
class Written(Protocol):
    """An object that is written as a line of a file."""

    def to_json(self) -> Mapping[str, Any]:
        """The JSON object for a file."""


@runtime_checkable
class Result(Written, Protocol):
    """A certified result for a condition."""

    @property
    def condition(self) -> Any:
        """The condition that it was generated for."""


C = TypeVar("C", bound=Written)  # conditions
R = TypeVar("R", bound=Result)


@dataclass(frozen=True)
class Formats(Generic[C, R]):
    """How a task's conditions and results stand in files.

    Attributes:
        condition: A condition from its JSON value and the name of the field that holds it; raises `InputError` naming
            the field if it is invalid.
        result: A result from its JSON value; raises `InputError` likewise.
        plain: A condition as JSON values, every default written out, so that equal conditions are equal values.
        lines: Types of the lines, as of `deggflow.lines`: of results, then of demonstrations if these differ.
        unverified: Fields of a result's line that can't be verified from the file.
    """

    condition: Callable[[Any, str], C]
    result: Callable[[Any], R]
    plain: Callable[[C], Any]
    lines: Sequence[type[Any]]
    unverified: Unverified

    def difference(self, expected: C, actual: C) -> Wrong | None:
        """The first difference between a requested condition and that of a line; None if they agree."""
        return first_difference(self.plain(expected), self.plain(actual), "condition")
