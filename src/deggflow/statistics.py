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


@dataclass(frozen=True)
class SuccessRow(CaseRow):
    """Success of nominal and guided results of one size: counts out of `cases`.

    Attributes:
        size: Number of agents.
        cases: Conditions, with the same z(0) for nominal and guided results.
        nominal: Nominal results that satisfy every requirement.
        first_draw: Guided results that do so at their first draw.
        satisfied: Guided results that do so within the limit of draws.
        most_draws: Largest number of draws of a guided result.
        least_margin: Of guided results with a claim of success; None without such claims.
        refuted: Claims that the oracle finds false.
    """

    size: int
    cases: int
    nominal: int
    first_draw: int
    satisfied: int
    most_draws: int
    least_margin: float | None
    refuted: int

    @property
    def complete(self) -> bool:
        """Whether every case was satisfied, and no claim of it refuted."""
        return self.satisfied == self.cases and not self.refuted

    @property
    def margin_text(self) -> str:
        """The least margin as tables show it."""
        return "-" if self.least_margin is None else f"{self.least_margin:.3g}"
