"""Proportions with confidence intervals."""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

MANY = 5_000  # number of cases from which a second decimal is meaningful


class Rate(NamedTuple):
    """A number of successes out of independent cases.

    Attributes:
        successes: Number of successes.
        cases: Number of cases.
    """

    successes: int
    cases: int

    @property
    def proportion(self) -> float:
        """The proportion, between 0 and 1."""
        return self.successes / self.cases

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Wilson score interval of the proportion."""
        from scipy.stats import binomtest  # takes long to import, and most commands have no rates

        interval = binomtest(self.successes, self.cases).proportion_ci(confidence, method="wilson")
        return float(interval.low), float(interval.high)

    def __str__(self) -> str:
        low, high = self.interval()
        digits = 1 if self.cases < MANY else 2
        proportion, *ends = (f"{100 * each:.{digits}f}" for each in (self.proportion, low, high))
        return f"{proportion}% [{', '.join(ends)}]"


@dataclass(frozen=True)
class Row:
    """A row of a table that is measured; a measurement derives its own fields from it."""

    def to_json(self) -> dict[str, Any]:
        """The fields by name, as a file holds them."""
        return asdict(self)


class CaseRow(Row):
    """A row that counts cases of some kinds, out of all its `cases`."""

    cases: int

    def rate(self, count: int) -> Rate:
        """A count as a proportion of the cases."""
        return Rate(count, self.cases)
