"""Timing of several ways to do something, in turn."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Call = Callable[[], Any]
"""Does the work and waits for its end."""


@dataclass
class Kept:
    """A call, and what it yielded last."""

    call: Call
    result: Any = None

    def __call__(self) -> None:
        """Makes the call."""
        self.result = self.call()


@dataclass(frozen=True)
class Patience:
    """How long is measured."""

    seconds: float  # for all ways of a comparison together; no round is begun after that
    least: int  # rounds, however long they take
    most: int


FULL = Patience(seconds=6.0, least=3, most=200)
QUICK = Patience(seconds=0.5, least=1, most=20)


def seconds_of(call: Call) -> float:
    """Time of one call."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def in_turn(calls: Mapping[str, Call], patience: Patience) -> dict[str, list[float]]:
    """Seconds of each call, round by round.

    A round calls each of them once, so that what else the machine does falls on all of them alike. The first
    round isn't counted: it compiles.
    """
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    begin = time.perf_counter()
    for turn in range(patience.most):
        if turn >= patience.least and time.perf_counter() - begin > patience.seconds:
            break
        for name, call in calls.items():
            times[name].append(seconds_of(call))
    return times
