"""`certify`: checks every line of a file against its requirements, itself and the requested condition."""

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
    """Checks a file of results, prints the findings and returns the exit code."""
    results = task.read_results(path)
    for line in options.lines:
        check_range("lines", line, 1, len(results))
    requests = None if options.conditions is None else task.read_conditions(options.conditions)
    conditions = [result.condition for result, _ in results]
    mismatches = compare_conditions(requests, conditions, task.formats.difference)
    examinations = []
    for number in options.lines or range(1, len(results) + 1):
        examination = task.examine(*results[number - 1])
        wrong = [*examination.wrong, *mismatches.of(number)]
        examinations.append(replace(examination, wrong=wrong))
        if not options.quiet:
            flaw = "; the line is wrong" if wrong else ""
            print(printable(f"line {number}: {examination.text}{flaw}"))
            print_wrong(number, wrong)
            print(f"the certificate says: {printable(examination.certificate)}\n")
    print_conclusion(mismatches, task.formats.unverified, quiet=options.quiet)
    output().print(task.conclude(examinations))
    satisfied = all(each.holds and not each.wrong for each in examinations)
    return SATISFIED if satisfied and mismatches.missing is None else NOT_SATISFIED


class ConditionMismatches(NamedTuple):
    """How the conditions of a file differ from the requested ones.

    Attributes:
        wrong: By line number, from 1: the first difference of its condition.
        missing: A message if the file has more or fewer lines than were requested; else None.
    """

    wrong: dict[int, Wrong]
    missing: str | None

    def of(self, number: int) -> list[Wrong]:
        """The mismatch of the condition of a line, numbered from 1, if there is one."""
        return [self.wrong[number]] if number in self.wrong else []


def compare_conditions(
    requests: Sequence[Condition] | None,
    conditions: Sequence[Condition],
    differ: Callable[[Condition, Condition], Wrong | None],
) -> ConditionMismatches:
    """Compares every line's condition with the requested one of the same number; without requests all match."""
    if requests is None:
        return ConditionMismatches({}, None)
    differences = {
        k: wrong
        for k, (one, other) in enumerate(zip(requests, conditions, strict=False), start=1)
        if (wrong := differ(one, other)) is not None
    }
    many, lines = len(requests), len(conditions)
    if many == lines:
        return ConditionMismatches(differences, None)
    what = "is missing" if many > lines else "was not asked for"
    missing = (
        f"line {min(many, lines) + 1} {what}: {many} lines were asked for, the file has {lines}"
    )
    return ConditionMismatches(differences, missing)


def print_wrong(number: int, wrong: Sequence[Wrong]) -> None:
    """Prints each false statement of a line on a line of its own."""
    for each in wrong:
        print(printable(f"line {number}: {each}"))


def print_conclusion(
    mismatches: ConditionMismatches, unverified: Unverified, *, quiet: bool
) -> None:
    """Prints whether lines are missing or superfluous and, in one line, the fields that a file can't verify."""
    if mismatches.missing is not None:
        print(mismatches.missing)
    if not quiet:
        print(unverified_line(unverified))
