"""A network in simulated time, decided by a seed: delays, losses, duplicates, partitions, and agents that crash or freeze."""

import heapq
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Process(Protocol):
    """What the simulation runs for each agent; `Member` is one."""

    def start(self) -> None:
        """Begins."""

    def receive(self, data: bytes, now: float) -> None:
        """Takes a message of another agent."""

    def tick(self, now: float) -> None:
        """Is called every `Network.tick` seconds."""

    def sent(self) -> list[bytes]:
        """Messages to all other agents, since the last call."""


@dataclass(frozen=True)
class Network:
    """How messages travel, in seconds of simulated time.

    Between two agents that run, some copy of what is repeated arrives within `outage + delay + tick`, whatever is lost: a link
    that has lost everything for `outage` seconds delivers the next message. So agents whose deadline is longer suspect
    nobody that runs.

    Attributes:
        delay: Longest delay of a message; each is delayed by a random part of it, so messages overtake each other.
        loss: Probability that a message is lost, for each receiver.
        duplication: Probability that a message arrives twice.
        outage: Longest time for which a link loses everything, partitions included.
        partitions: Number of partitions. Each cuts the team in two for at most `outage`.
        tick: Time between repetitions.
        compute: Longest time that an agent takes to answer a message.
    """

    delay: float = 0.05
    loss: float = 0.1
    duplication: float = 0.1
    outage: float = 0.5
    partitions: int = 1
    tick: float = 0.1
    compute: float = 0.01

    @property
    def deadline(self) -> float:
        """A deadline that suspects nobody that runs."""
        return 2 * (self.outage + self.delay + self.tick + self.compute)


@dataclass(frozen=True)
class Fault:
    """An agent that crashes or freezes while it sends.

    Attributes:
        agent: Its number.
        message: After how many sent copies; a broadcast is one copy for each receiver.
        frozen: Seconds for which it freezes; infinite if it crashes.
    """

    agent: int
    message: int
    frozen: float = float("inf")


@dataclass
class Outcome:
    """What became of the processes.

    Attributes:
        errors: Of those that gave up, by number.
        crashed: Numbers of those that crashed.
        time: When the last one was done.
        copies: Number of copies sent.
        bytes: Their bytes in all.
    """

    errors: dict[int, Exception] = field(default_factory=dict)
    crashed: set[int] = field(default_factory=set)
    time: float = 0.0
    copies: int = 0
    bytes: int = 0


class Simulation:
    """Runs processes on a network; the same seed gives the same run, message by message."""

    def __init__(
        self, processes: Sequence[Process], network: Network, faults: Sequence[Fault], seed: int
    ) -> None:
        """Args: processes: by number; network: between them; faults: which agents crash or freeze; seed: decides all else."""
        self._processes, self._network = processes, network
        self._random = random.Random(seed)
        self._faults = {fault.agent: fault for fault in faults}
        self._sent = [0] * len(processes)
        self._frozen_until = [0.0] * len(processes)
        self._silent_since: dict[tuple[int, int], float] = {}  # links that lose everything
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0
        self.now, self.outcome = 0.0, Outcome()

    def run(self, finished: Callable[[Any], bool], limit: float = 1e4) -> Outcome:
        """Runs until every process has finished, crashed or given up.

        Args:
            finished: Of a process.
            limit: Seconds of simulated time.

        Raises:
            TimeoutError: Some process has not finished by then.
        """
        random_, horizon = self._random, 10 * self._network.outage
        self._cuts = [
            (begin, begin + random_.uniform(0, self._network.outage), self._some())
            for begin in (random_.uniform(0, horizon) for _ in range(self._network.partitions))
        ]
        for number, process in enumerate(self._processes):
            self._at(random_.uniform(0, self._network.delay), number, process.start)
            self._at(random_.uniform(0, self._network.tick), number, lambda k=number: self._tick(k))
        waiting = set(range(len(self._processes)))
        while waiting:
            self.now, _, action = heapq.heappop(self._queue)
            if self.now > limit:
                raise TimeoutError(f"agents {sorted(waiting)} did not finish in {limit} s")
            action()
            gone = self.outcome.crashed | self.outcome.errors.keys()
            waiting = {k for k in waiting if k not in gone and not finished(self._processes[k])}
        self.outcome.time = self.now
        return self.outcome

    def _some(self) -> frozenset[int]:
        numbers = range(len(self._processes))
        return frozenset(k for k in numbers if self._random.random() < 0.5)

    def _at(self, time: float, number: int, action: Callable[[], None]) -> None:
        """Has a process do something, unless it is gone by then; if it is frozen, when it thaws."""

        def act() -> None:
            if number in self.outcome.crashed or number in self.outcome.errors:
                return
            if self.now < self._frozen_until[number]:
                self._at(self._frozen_until[number], number, action)
                return
            try:
                action()
            except Exception as error:
                self.outcome.errors[number] = error
            self._send(number)

        self._number += 1
        heapq.heappush(self._queue, (time, self._number, act))

    def _tick(self, number: int) -> None:
        self._at(self.now + self._network.tick, number, lambda: self._tick(number))
        self._processes[number].tick(self.now)

    def _send(self, number: int) -> None:
        """Sends what a process has to say, copy by copy, until it crashes."""
        ready = self.now + self._random.uniform(0, self._network.compute)
        for message in self._processes[number].sent():
            others = [k for k in range(len(self._processes)) if k != number]
            self._random.shuffle(others)
            for other in others:
                fault = self._faults.get(number)
                if fault is not None and self._sent[number] >= fault.message:
                    del self._faults[number]
                    if fault.frozen == float("inf"):
                        self.outcome.crashed.add(number)
                        return
                    # What it still had to send leaves when it thaws.
                    ready = self._frozen_until[number] = self.now + fault.frozen
                self._sent[number] += 1
                self.outcome.copies += 1
                self.outcome.bytes += len(message)
                self._deliver(number, other, message, ready)

    def _deliver(self, sender: int, receiver: int, message: bytes, ready: float) -> None:
        network, random_, link = self._network, self._random, (sender, receiver)
        cut = any(
            begin <= self.now < end and (sender in part) != (receiver in part)
            for begin, end, part in self._cuts
        )
        if cut or random_.random() < network.loss:
            since = self._silent_since.setdefault(link, self.now)
            if cut or self.now - since < network.outage:
                return
        self._silent_since.pop(link, None)
        for _ in range(1 + (random_.random() < network.duplication)):
            arrival = ready + random_.uniform(0, network.delay)
            self._at(
                arrival, receiver,
                lambda: self._processes[receiver].receive(message, self.now),
            )  # fmt: skip
