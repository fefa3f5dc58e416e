"""How the summary of a generation contradicts the requirements or the sample that it is certified for."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .generation import Generation
from .guidance import DecoupledGuidance
from .identity import requirement_numbers
from .judge import Judged

SAME = 1e-3  # relative to the larger of values and limits: difference of two float32 programs


class _Found:
    """The first contradiction of each sample."""

    def __init__(self, samples: int) -> None:
        self.why: list[str | None] = [None] * samples

    def tell(self, wrong: Bool[np.ndarray, " samples"], why: Callable[[int], str]) -> None:
        """Adds one of some samples, unless they have one."""
        for k in np.flatnonzero(wrong).tolist():
            if self.why[k] is None:
                self.why[k] = why(k)


def contradictions(
    samples: Generation, judgement: Judged, guidance: DecoupledGuidance
) -> list[str | None]:
    """How the summary of each generation contradicts these requirements or its sample; None where it agrees.

    Args:
        samples: Numpy arrays with a leading axis of samples.
        judgement: Of these samples, likewise.
        guidance: By the requirements asked about.
    """
    summary, names, count = samples.summary, guidance.names, len(samples.z)
    other = "the sample was generated under other requirements"
    if summary.value.shape != judgement.value.shape:
        return [f"{other}: {summary.value.shape[-1]} requirements, here are {len(names)}"] * count
    found = _Found(count)
    found.tell(_differ(samples.z, summary.z), lambda k: "z is not the end of its generation")
    differs = _differ(summary.condition, judgement.condition)
    found.tell(differs, lambda k: "the sample was generated under another condition")
    stored = summary.requirements  # empty for a trajectory and for a user's own guidance
    if stored.shape[1] == len(guidance.requirements):
        numbers = requirement_numbers(guidance.requirements)[None]
        for row, each in enumerate(guidance.requirements):
            pair = stored[:, row], numbers[:, row]
            known = (pair[0] != 0) & (pair[1] != 0)
            text = f"{other}: `{', '.join(each.names)}` is another"
            found.tell(known & (pair[0] != pair[1]), lambda k, text=text: text)
    _compare_ends(samples, judgement, names, found)
    return found.why


def _compare_ends(
    samples: Generation, judgement: Judged, names: tuple[str, ...], found: _Found
) -> None:
    """Compares values and limits at tau = 0 and 1 with those that the requirements have there."""
    summary, undefined = samples.summary, np.asarray(samples.summary.not_a_number)
    ends = (
        (0, summary.z0, (summary.first_value, judgement.first_value), (summary.first_limit, judgement.first_limit)),
        (1, summary.z, (summary.value, judgement.value), (summary.limit, judgement.limit)),
    )  # fmt: skip
    for tau, z, values, limits in ends:
        scale = np.max([_magnitude(each) for each in (*values, *limits)], axis=0)
        size = np.minimum(_magnitude(z).max(axis=(1, 2)).astype(float), 1e12)
        least = (1e-5 * size[:, None]) ** 2  # V of rounded states that meet h = buffer
        for what, (was, here) in (("value", values), ("limit", limits)):
            # NaN and values beyond float32 are reported elsewhere.
            with np.errstate(invalid="ignore", over="ignore"):
                same = (np.abs(was - here) <= SAME * scale + least) | ~np.isfinite(was)
            same |= ~np.isfinite(here) & undefined[:, None]

            def differs(
                k: int,
                same: Any = same,
                was: Any = was,
                here: Any = here,
                what: str = what,
                tau: int = tau,
            ) -> str:
                row = int(np.argmin(same[k]))
                return (
                    f"the sample was generated under other requirements: the {what} at tau = {tau} of {names[row]} "
                    f"was {was[k, row]:.3g}, here it is {here[k, row]:.3g}"
                )

            found.tell(~same.all(axis=1), differs)


def _differ(some: Any, others: Any) -> Bool[np.ndarray, " samples"]:
    """Which samples' arrays are not equal, NaN to NaN; all if their shapes differ."""
    if np.shape(some) != np.shape(others):
        return np.ones(len(some), bool)
    same = np.equal(some, others)
    if np.issubdtype(np.asarray(some).dtype, np.floating):
        same |= np.isnan(some) & np.isnan(others)
    return ~same.all(axis=tuple(range(1, same.ndim)))


def _magnitude(values: Any) -> Float[np.ndarray, "..."]:
    return np.abs(np.nan_to_num(values))
