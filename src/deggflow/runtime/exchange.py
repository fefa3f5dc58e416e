"""Rounds in which each process tells every other one something of its own, and waits for all of them.

Nobody begins a round before it has completed the one before, so two processes are at most one round apart: what a
process may still need of another are the messages of two rounds. Nothing is agreed on: a process that is lost ends them all.
"""

import time
from collections.abc import Callable, Mapping
from struct import Struct

from .agreement import TeamError
from .process import RoundStatistics, Timing
from .transport import DirectTransport

HEADER = Struct("<4sBxxxI")
MAGIC = b"dgx1"


class Exchange:
    """One process's part in the rounds of all.

    Attributes:
        others: Numbers of the other processes.
        rounds: Complete rounds.
    """

    def __init__(
        self,
        number: int,
        processes: int,
        transport: DirectTransport,
        timing: Timing,
        on_round: Callable[[RoundStatistics], None] = lambda statistics: None,
    ) -> None:
        """Args: number: of this process; processes: how many there are; transport: to the others; timing: deadline and repetitions; on_round: told of every round.

        Raises:
            ValueError: There is no such process.
        """
        if not 0 <= number < processes <= 255:
            raise ValueError(
                f"`number` must be below the number of processes, at most 255; got {number} of {processes}."
            )
        self.others = tuple(k for k in range(processes) if k != number)
        self.rounds = 0
        self._number, self._transport, self._timing = number, transport, timing
        self._on_round = on_round
        self._before: dict[int, bytes] = {}  # messages of the round before
        self._now: dict[int, bytes] = {}
        self._early: dict[int, bytes] = {}  # of the round after this one
        self._messages = self._bytes = 0
        self._since = time.monotonic()

    def swap(
        self, messages: Mapping[int, bytes], patience: float | None = None
    ) -> dict[int, bytes]:
        """Tells each other process something, and returns what these have told, by their numbers.

        Args:
            messages: For each other process.
            patience: Seconds of silence after which a process is missed; the deadline if None.

        Raises:
            TeamError: A process has ended, or was silent for too long.
        """
        self._before, self._now = self._now, self._framed(messages)
        told, self._early = self._early, {}
        straggler = None
        heard = dict.fromkeys(self.others, time.monotonic())
        for other in self.others:
            self._transport.send(other, self._now[other])
        next_tick = time.monotonic() + self._timing.tick
        while len(told) < len(self.others):
            data = self._transport.receive(max(next_tick - time.monotonic(), 0.0))
            if data is not None:
                if self._take(data, told, heard):
                    straggler = data[4]
                continue
            self._miss(heard, told, self._timing.deadline if patience is None else patience)
            self._repeat(told)
            next_tick = time.monotonic() + self._timing.tick
        self._complete(straggler)
        return told

    def finish(self) -> None:
        """Repeats the last messages until all others have them, or nobody can still be waiting."""
        try:
            self.swap(dict.fromkeys(self.others, b""))
        except TeamError:
            return  # the others have left with what they needed
        for _ in range(3):  # the last messages may be lost as well
            self._repeat({})
            time.sleep(self._timing.tick)

    def _framed(self, messages: Mapping[int, bytes]) -> dict[int, bytes]:
        header = HEADER.pack(MAGIC, self._number, self.rounds + 1)
        return {other: header + messages[other] for other in self.others}

    def _take(self, data: bytes, told: dict[int, bytes], heard: dict[int, float]) -> bool:
        """Sorts a message; returns whether it is a new one of this round."""
        if len(data) < HEADER.size:
            return False
        magic, sender, round_ = HEADER.unpack_from(data)
        if magic != MAGIC or sender not in heard:
            return False
        self._messages, self._bytes = self._messages + 1, self._bytes + len(data)
        heard[sender] = time.monotonic()
        if round_ == self.rounds + 2:
            self._early[sender] = data[HEADER.size :]
        if round_ != self.rounds + 1 or sender in told:
            return False
        told[sender] = data[HEADER.size :]
        return True

    def _miss(self, heard: Mapping[int, float], told: Mapping[int, bytes], patience: float) -> None:
        gone = self._transport.gone()
        for other in self.others:
            silent = time.monotonic() - heard[other] > patience
            if other not in told and (silent or other in gone):
                why = f"was silent for {patience:g} s" if silent else "has ended"
                raise TeamError(
                    f"process {other} {why} in round {self.rounds + 1}; processes with several agents need all others."
                )

    def _repeat(self, told: Mapping[int, bytes]) -> None:
        """Sends again what others may have missed: who has told something in this round has completed the one before."""
        for other in self.others:
            if other not in told and other in self._before:
                self._transport.send(other, self._before[other])
            self._transport.send(other, self._now[other])

    def _complete(self, straggler: int | None) -> None:
        self.rounds += 1
        now = time.monotonic()
        members = len(self.others) + 1
        self._on_round(
            RoundStatistics(
                self.rounds, now - self._since, self._messages, self._bytes, straggler, members
            )
        )
        self._since, self._messages, self._bytes = now, 0, 0
