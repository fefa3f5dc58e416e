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
    turn: float = 0.02  # s that a way has in a round: short calls are repeated


FULL = Patience(seconds=6.0, least=3, most=200)
QUICK = Patience(seconds=0.5, least=1, most=20)


def seconds_of(call: Call, turn: float = 0.0) -> float:
    """Time of one call; the mean of several where they are shorter than a turn."""
    count, begin = 0, time.perf_counter()
    while True:
        call()
        count, passed = count + 1, time.perf_counter() - begin
        if passed >= turn:
            return passed / count


def in_turn(calls: Mapping[str, Call], patience: Patience) -> dict[str, list[float]]:
    """Seconds of each call, round by round.

    In a round each of them has a turn, so that what else the machine does falls on all of them alike. Before the
    first round each is called once, uncounted: it compiles.
    """
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    begin = time.perf_counter()
    for turn in range(patience.most):
        if turn >= patience.least and time.perf_counter() - begin > patience.seconds:
            break
        for name, call in calls.items():
            times[name].append(seconds_of(call, patience.turn))
    return times
