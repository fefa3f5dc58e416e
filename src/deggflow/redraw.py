"""Redraws: a sample that its verdict refuses is redrawn from a new z(0), up to a limit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from .certificate import Certificate


class Certified(Protocol):
    """A dataclass of a sample and what is said of it."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def certificate(self) -> Certificate:
        """What is said of the sample."""
        ...


T = TypeVar("T")
C = TypeVar("C", bound=Certified)


@dataclass(frozen=True)
class Candidate(Generic[T]):
    """A single draw of a sample, and its verdict.

    Attributes:
        sample: The sample.
        satisfied: Whether the verdict accepts it.
        margin: Of the candidates that are refused, the one with the greatest margin is kept.
    """

    sample: T
    satisfied: bool
    margin: float


@dataclass(frozen=True)
class Drawn(Generic[T]):
    """The final draw of a sample.

    Attributes:
        sample: The first draw that is satisfied, else the closest.
        satisfied: Whether the verdict accepts it.
        draws: Number of draws.
    """

    sample: T
    satisfied: bool
    draws: int


Attempt = Callable[[Sequence[int], int], Sequence[Candidate[T]]]
"""(numbers of the pending samples, number of the draw from 0) -> a candidate for each."""


def redraw_until_satisfied(attempt: Attempt[T], samples: int, max_draws: int) -> list[Drawn[T]]:
    """Draws each sample until it is satisfied, at most `max_draws` times; else returns the closest draw.

    Args:
        attempt: Draws the pending samples once.
        samples: Number of samples.
        max_draws: Limit of draws of each sample; at least 1.
    """
    if max_draws < 1:
        raise ValueError(f"`max_draws` must be at least 1; got {max_draws}.")
    pending: Sequence[int] = range(samples)
    closest: dict[int, Candidate[T]] = {}
    draws = dict.fromkeys(pending, 0)
    for number in range(max_draws):
        if not pending:
            break
        for k, candidate in zip(pending, attempt(pending, number), strict=True):
            draws[k] = number + 1
            if k not in closest or candidate.satisfied or candidate.margin > closest[k].margin:
                closest[k] = candidate
        pending = [k for k in pending if not closest[k].satisfied]
    return [Drawn(closest[k].sample, closest[k].satisfied, draws[k]) for k in range(samples)]


def finished(samples: Sequence[Drawn[C]]) -> list[C]:
    """Samples with the number of draws in their certificates."""
    return [with_draws(each.sample, each.draws) for each in samples]


def with_draws(sample: C, draws: int) -> C:
    """The sample with this number of draws in its certificate."""
    return replace(sample, certificate=replace(sample.certificate, draws=draws))
