"""Proportions with confidence intervals."""

from dataclasses import asdict, dataclass
from math import sqrt
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
        """Wilson score interval of the proportion; scipy.stats has it too, but takes a third of a second to import."""
        from scipy.special import ndtri

        p, n, z = self.proportion, self.cases, float(ndtri(0.5 + 0.5 * confidence))
        scale = 2 * (n + z**2)
        centre = (2 * n * p + z**2) / scale
        half = z / scale * sqrt(4 * n * p * (1 - p) + z**2)
        low = centre - half if self.successes else 0.0
        high = centre + half if self.successes < n else 1.0
        return low, high

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
