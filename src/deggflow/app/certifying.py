"""What both `certify` commands share: lines with what they hold, and lines against what was asked for."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from deggflow.consistency import Line, Unverified, Wrong, unverified_line
from deggflow.jsonl import read_lines

from .runs import in_range, printable

Condition = TypeVar("Condition")
T = TypeVar("T")


def read(path: Path, parse: Callable[[Line], T], what: str) -> list[tuple[T, Line]]:
    """What every line holds, and the line; `InputError` for the first that is wrong."""
    return read_lines(path, lambda line: (parse(line), line), what)


def chosen_lines(lines: Sequence[int], count: int) -> Sequence[int]:
    """The lines asked for, or all; `InputError` where there is none of that number."""
    for line in lines:
        in_range("lines", line, 1, count)
    return lines or range(1, count + 1)


class Asked(NamedTuple):
    """In what a file differs from what was asked for."""

    wrong: dict[int, Wrong]  # by line, from 1, the first difference of its condition
    missing: str | None  # what is said where there are more lines or fewer than were asked for

    def of(self, number: int) -> list[Wrong]:
        """What is wrong with the condition of a line, from 1."""
        return [self.wrong[number]] if number in self.wrong else []


def against(
    asked: Sequence[Condition] | None,
    given: Sequence[Condition],
    differ: Callable[[Condition, Condition], Wrong | None],
) -> Asked:
    """Compares every line's condition with the one of the same number that was asked for, if any were."""
    if asked is None:
        return Asked({}, None)
    found = {
        k: wrong
        for k, (one, other) in enumerate(zip(asked, given, strict=False), start=1)
        if (wrong := differ(one, other)) is not None
    }
    if len(asked) == len(given):
        return Asked(found, None)
    first = min(len(asked), len(given)) + 1
    what = "is missing" if len(asked) > len(given) else "was not asked for"
    return Asked(
        found, f"line {first} {what}: {len(asked)} lines were asked for, the file has {len(given)}"
    )


def tell(number: int, wrong: Sequence[Wrong]) -> None:
    """Prints everything that is wrong in a line, one sentence a line."""
    for each in wrong:
        print(printable(f"line {number}: {each}"))


def conclude(asked: Asked, unverified: Unverified, *, quiet: bool) -> None:
    """Prints what is wrong with the file as a whole and, in one line, what no file can show."""
    if asked.missing is not None:
        print(asked.missing)
    if not quiet:
        print(unverified_line(unverified))
