"""Redraws: a sample that its verdict refuses is drawn again from a new z(0), up to a limit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from .certificate import Certificate

T = TypeVar("T")

# Sizes of compiled batches; the last partial batch is padded to one of them.
BATCHES = (1, 16, 64, 128, 512)


@dataclass(frozen=True)
class Candidate(Generic[T]):
    """A decoded sample and what its verdict says."""

    sample: T
    certificate: Certificate


def draw(
    attempt: Callable[[Sequence[int], int], Sequence[Candidate[T]]], samples: int, max_draws: int
) -> list[Candidate[T]]:
    """Draws each sample until it is satisfied, at most `max_draws` times; else keeps the closest.

    Args:
        attempt: Called with the indices of the pending samples and the number of the draw, from 0.
        samples: How many samples are wanted.
        max_draws: Limit of draws of each; at least 1.

    Returns:
        One candidate per sample; its certificate counts the draws that were made.
    """
    if max_draws < 1:
        raise ValueError(f"`max_draws` must be at least 1; got {max_draws}.")
    pending: Sequence[int] = range(samples)
    kept: dict[int, Candidate[T]] = {}
    for number in range(max_draws):
        if not pending:
            break
        for k, candidate in zip(pending, attempt(pending, number), strict=True):
            if k not in kept or _better(candidate.certificate, kept[k].certificate):
                kept[k] = candidate
            certificate = replace(kept[k].certificate, draws=number + 1)
            kept[k] = replace(kept[k], certificate=certificate)
        pending = [k for k in pending if not kept[k].certificate.satisfied]
    return [kept[k] for k in range(samples)]


def _better(new: Certificate, old: Certificate) -> bool:
    return new.satisfied or new.min_margin > old.min_margin


def padded_batch(samples: int) -> int:
    """Size of the compiled batch that holds `samples`, at most the largest of `BATCHES`."""
    return next((size for size in BATCHES if size >= samples), BATCHES[-1])
