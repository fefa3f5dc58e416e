"""`certify`: every line of a file against its requirements, against itself, and against what was asked for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from deggflow.consistency import Unverified, Wrong, unverified_line
from deggflow.task import AbstractTask, CertifyOptions, check_range

from .runs import printable
from .session import NOT_SATISFIED, SATISFIED, output

Condition = TypeVar("Condition")


def certify_file(task: AbstractTask[Any, Any], path: Path, options: CertifyOptions) -> int:
    """Checks a file of results; prints what is found, and returns the exit code."""
    results = task.read_results(path)
    for line in options.lines:
        check_range("lines", line, 1, len(results))
    wanted = None if options.conditions is None else task.read_conditions(options.conditions)
    given = [result.condition for result, _ in results]
    asked = against(wanted, given, task.other_condition)
    examinations = []
    for number in options.lines or range(1, len(results) + 1):
        examined = task.examine(*results[number - 1])
        examined = replace(examined, wrong=[*examined.wrong, *asked.of(number)])
        examinations.append(examined)
        if not options.quiet:
            flaw = "; the line is wrong" if examined.wrong else ""
            print(printable(f"line {number}: {examined.text}{flaw}"))
            tell(number, examined.wrong)
            print(f"the certificate says: {printable(examined.certificate)}\n")
    conclude(asked, task.unverified, quiet=options.quiet)
    output().print(task.conclude(examinations))
    good = all(each.holds and not each.wrong for each in examinations) and asked.missing is None
    return SATISFIED if good else NOT_SATISFIED


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
