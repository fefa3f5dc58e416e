"""Shares with their uncertainty."""

from typing import NamedTuple

from scipy.stats import binomtest


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
        return f"{100 * self.share:.1f}% [{100 * low:.1f}, {100 * high:.1f}]"
