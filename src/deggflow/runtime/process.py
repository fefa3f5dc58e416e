"""One agent as a process: it compiles, waits for the others, and takes part until all have the sample."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from deggflow.generation import Generation

from .agent import Agent, TeamGeneration
from .agreement import HEADER, MAGIC, Header, TeamError
from .member import Member, team_digest
from .program import Start, TeamProgram
from .transport import Transport

HELLO = b"dgf1hello"


@dataclass(frozen=True)
class Timing:
    """Times of a process, in seconds.

    Attributes:
        deadline: Silence after which an agent is lost. It must be longer than any agent that runs may be silent: a computation
            between two messages, and whatever else the machine does.
        tick: Time between repetitions of messages.
        join: How long to wait for the others to start.
    """

    deadline: float = 5.0
    tick: float = 0.1
    join: float = 300.0

    def __post_init__(self) -> None:
        for name in ("deadline", "tick", "join"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"`{name}` must be positive, in seconds; got {getattr(self, name)}."
                )
        if self.tick > self.deadline / 3:
            raise ValueError(
                "`tick` must be at most a third of `deadline`, as one message may be lost; "
                f"got {self.tick} and {self.deadline}."
            )


class RoundStatistics(NamedTuple):
    """How one round went, as its process saw it.

    Attributes:
        round: Number, from 1.
        seconds: From the end of the round before.
        messages: Received messages.
        bytes: Their bytes.
        straggler: Number of the agent whose message completed the round; None if it was this one.
        members: How many agents took part.
    """

    round: int
    seconds: float
    messages: int
    bytes: int
    straggler: int | None
    members: int


def run_agent(
    program: TeamProgram,
    number: int,
    start: Start,
    transport: Transport,
    *,
    faults: int,
    timing: Timing | None = None,
    greet: bool = True,
    on_round: Callable[[RoundStatistics], None] = lambda statistics: None,
) -> TeamGeneration:
    """Takes part in a generation as one of its agents, until all that go on have the sample.

    Args:
        program: Of the team.
        number: Of this agent.
        start: `program.start(z0, condition)`.
        transport: To the others.
        faults: How many agents may be lost.
        timing: Deadline, repetitions and patience; `Timing()` if None.
        greet: Wait until all others have started. In a later generation of the same processes it need not be so: who does
            not begin within the deadline is lost.
        on_round: Told of every round.

    Raises:
        TeamError: The agent can't go on as a member of its team, or some never started.
    """
    timing = timing or Timing()
    if greet:
        compile_agent(program, number, start)
        _Waiting(program, number, start, transport).wait(timing)
    member = Member(
        program, number, start, faults=faults, deadline=timing.deadline, now=time.monotonic()
    )
    loop = _Loop(member, transport, timing, on_round)
    member.start()
    try:
        while member.generated is None:
            loop.turn()
    finally:
        loop.send()
    assert member.generated is not None
    _linger(member, loop, timing)
    return member.generated


def compile_agent(program: TeamProgram, number: int, start: Start) -> Generation:
    """Compiles all that an agent runs before others wait for it; returns an unfinished generation, for its shapes.

    Args: as of `run_agent`.
    """
    trial = Agent(program, number, start)
    message = trial.first_message()
    trial.next_message(dict.fromkeys(start.present, message))
    return trial.unfinished()


class _Waiting:
    """Until all others have been heard."""

    def __init__(
        self, program: TeamProgram, number: int, start: Start, transport: Transport
    ) -> None:
        self._team = team_digest(program, start)
        team = self._team.to_bytes(8, "little")
        self._greetings = {HELLO + team + bytes([k]): k for k in start.present}
        self._own = HELLO + team + bytes([number])
        self._missing = set(start.present) - {number}
        self._transport = transport

    def wait(self, timing: Timing) -> None:
        """Greets until everybody has greeted."""
        end, next_tick = time.monotonic() + timing.join, 0.0
        while self._missing:
            if time.monotonic() > end:
                raise TeamError(
                    f"agents {sorted(self._missing)} did not start within {timing.join:g} s."
                )
            if time.monotonic() >= next_tick:
                self._transport.broadcast(self._own)
                next_tick = time.monotonic() + timing.tick
            data = self._transport.receive(timing.tick)
            if data is not None:
                self._missing.discard(self._sender(data))
        # Who still waits for this agent may have missed its greetings.
        self._transport.broadcast(self._own)

    def _sender(self, data: bytes) -> int:
        if data in self._greetings:
            return self._greetings[data]
        if len(data) < HEADER.size:
            return -1
        header = Header(*HEADER.unpack_from(data))
        # Whoever has begun has greeted before.
        begun = header.magic == MAGIC and header.team == self._team
        return header.sender if begun else -1


class _Loop:
    """Between a member and its transport."""

    def __init__(
        self,
        member: Member,
        transport: Transport,
        timing: Timing,
        on_round: Callable[[RoundStatistics], None],
    ) -> None:
        self._member, self._transport, self._timing = member, transport, timing
        self._on_round, self._round = on_round, 0
        self._since = self._next_tick = time.monotonic()
        self._messages = self._bytes = 0

    def turn(self) -> None:
        """Sends, receives what has come, and repeats what is due.

        Messages are read before silence is judged: a process that was stopped finds what it missed.
        """
        self.send()
        data = self._transport.receive(max(self._next_tick - time.monotonic(), 0.0))
        while data is not None:
            self._take(data)
            self.send()
            data = self._transport.receive(0.0)
        for one in self._transport.gone():
            self._member.suspect(one)
        if time.monotonic() >= self._next_tick:
            self._next_tick = time.monotonic() + self._timing.tick
            self._member.tick(time.monotonic())

    def send(self) -> None:
        """Sends what the member has to say."""
        for message in self._member.sent():
            self._transport.broadcast(message)

    def _take(self, data: bytes) -> None:
        self._messages, self._bytes = self._messages + 1, self._bytes + len(data)
        self._member.receive(data, time.monotonic())
        agreement, now = self._member.agreement, time.monotonic()
        if agreement.rounds > self._round:
            straggler = int(data[5]) if len(data) >= HEADER.size else None
            self._on_round(
                RoundStatistics(
                    agreement.rounds, now - self._since, self._messages, self._bytes,
                    straggler, len(agreement.members),
                )
            )  # fmt: skip
            self._round, self._since, self._messages, self._bytes = agreement.rounds, now, 0, 0


def _linger(member: Member, loop: _Loop, timing: Timing) -> None:
    """Repeats the end for those that may not have it, until all have it or nobody can still be waiting."""
    end = time.monotonic() + 2 * timing.deadline
    try:
        while not member.released and time.monotonic() < end:
            loop.turn()
        for _ in range(3):  # the others' last messages may be lost as well
            member.tick(time.monotonic())
            loop.send()
            time.sleep(timing.tick)
    except TeamError:
        return  # others have left; the sample is what all have agreed on
