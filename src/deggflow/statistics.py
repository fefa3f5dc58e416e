"""Shares with their uncertainty."""

from typing import NamedTuple

from scipy.stats import binomtest

MANY = 5_000  # cases from which on a second digit means something


class Rate(NamedTuple):
    """A count out of a number of independent cases."""

    hits: int
    cases: int

    @property
    def share(self) -> float:
        """The share, between 0 and 1."""
        return self.hits / self.cases

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Wilson score interval of the share."""
        found = binomtest(self.hits, self.cases).proportion_ci(confidence, method="wilson")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        low, high = self.interval()
        digits = 1 if self.cases < MANY else 2
        share, *ends = (f"{100 * each:.{digits}f}" for each in (self.share, low, high))
        return f"{share}% [{', '.join(ends)}]"
