"""Rounds in which every member of a team gets the same contents from all, though members crash or freeze.

An agent takes part in a round by one content. The round is complete when it has the contents of all members. As no
member begins a round before it has completed the one before, any two are at most one round apart.

A member that has been silent for too long is suspected. Suspicions spread: who hears of one adopts it, no longer
listens to the suspect, stops at the last round it has completed, and states that round, with its contents, and its
suspects. Members that are one round behind complete it from the statement. A member decides once every other that it does
not suspect states the same round and the same suspects: these are lost, the others go on from that round
(docs/runtime.md has the proof that any two who go on decide the same). Who is suspected itself leaves.

Nothing here waits, reads a clock or opens a socket: whoever drives it passes messages and times in, and sends what is
in the outbox to all others.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import blake2b
from struct import Struct
from typing import NamedTuple

MAX_AGENTS = 64  # suspects are the bits of one number
CONTENT, STATEMENT, DECISION = 1, 2, 3

HEADER = Struct("<4sBBHIQQQ")
MAGIC = b"dgf1"


class Header(NamedTuple):
    """In front of every message, little-endian without padding.

    Attributes:
        magic: b"dgf1"; 4 bytes.
        kind: A content, a statement or a decision; 1 byte.
        sender: Number of the agent; 1 byte.
        epoch: How often agents were lost; 2 bytes.
        round: Of the content; of a statement or a decision, the last complete one; 4 bytes.
        team: Tells generations apart; 8 bytes.
        suspects: One bit for each agent; 8 bytes.
        history: Digest of all contents of all earlier rounds; 8 bytes.
    """

    magic: bytes
    kind: int
    sender: int
    epoch: int
    round: int
    team: int
    suspects: int
    history: int


class TeamError(RuntimeError):
    """The agent can't go on as a member of its team; it has no result."""


class SuspectedError(TeamError):
    """The others go on without this agent, as they did not hear from it in time."""


class TooManyLostError(TeamError):
    """More agents are silent than the team is made for."""


class DisagreementError(TeamError):
    """Two members hold different contents of one round: a program or a machine is at fault."""


class RoundComplete(NamedTuple):
    """All members' contents of a round.

    Attributes:
        contents: By the member's number.
    """

    contents: dict[int, bytes]


class MembersLost(NamedTuple):
    """Members that all who go on agree to be lost, after the last complete round.

    Attributes:
        lost: Their numbers.
    """

    lost: frozenset[int]


Event = RoundComplete | MembersLost


class Agreement:
    """One agent's part in the rounds of its team.

    Attributes:
        members: Numbers of those that are not lost, this agent included.
        suspects: Numbers of those that are lost or suspected.
        rounds: Complete rounds so far.
        outbox: Messages that are to be sent to all other agents, in order; whoever sends them clears it.
        refused: Messages that were not of this team or not of this form.
    """

    def __init__(
        self,
        number: int,
        agents: int,
        *,
        team: int,
        size: int,
        faults: int,
        deadline: float,
        now: float,
        absent: Iterable[int] = (),
    ) -> None:
        """A team whose members have all started.

        Args:
            number: Of this agent.
            agents: How many there are.
            team: Digest by which messages of other generations are told apart, of 64 bits.
            size: Bytes of a content.
            faults: How many may be lost.
            deadline: Seconds of silence after which a member is suspected.
            now: The time.
            absent: Numbers of agents that were never there.

        Raises:
            ValueError: Numbers do not fit.
        """
        if not 1 <= agents <= MAX_AGENTS:
            raise ValueError(f"`agents` must be between 1 and {MAX_AGENTS}; got {agents}.")
        self.members = frozenset(range(agents)) - frozenset(absent)
        if number not in self.members:
            raise ValueError(f"`number` must be one of {sorted(self.members)}; got {number}.")
        if not 0 <= faults < len(self.members):
            raise ValueError(
                f"`faults` must be at least 0 and leave one of {len(self.members)} agents; got {faults}."
            )
        if not deadline > 0:
            raise ValueError(f"`deadline` must be positive, in seconds; got {deadline}.")
        self.number, self.faults, self.deadline = number, faults, deadline
        self.suspects: frozenset[int] = frozenset()
        self.rounds, self.refused = 0, 0
        self.outbox: list[bytes] = []
        self._team, self._size, self._epoch, self._history = team, size, 0, 0
        self._events: list[Event] = []
        self._recovering = False
        self._contents: dict[int, bytes] = {}  # of the round under way
        self._ahead: dict[int, tuple[int, bytes]] = {}  # of the next one, with their history
        self._last: dict[int, bytes] = {}  # of the last complete round
        self._before = 0  # history in front of that round
        self._statements: dict[int, tuple[int, frozenset[int]]] = {}
        self._repeated: list[bytes] = []  # what others may still need of the time before this round
        self._heard = dict.fromkeys(self.members - {number}, now)

    def publish(self, content: bytes) -> list[Event]:
        """Takes part in the round under way; returns what follows from it.

        Raises:
            ValueError: It has another size, or this agent has already taken part.
        """
        if len(content) != self._size:
            raise ValueError(f"`content` must have {self._size} bytes; got {len(content)}.")
        if self.number in self._contents:
            raise ValueError(f"`content` of round {self.rounds + 1} was published before.")
        self._contents[self.number] = content
        if not self._recovering:
            self.outbox.append(self._content_message())
        self._complete_if_all_are_there()
        return self._taken_events()

    def receive(self, data: bytes, now: float) -> list[Event]:
        """Takes a message of another agent; returns what follows from it.

        Raises:
            SuspectedError: The team goes on without this agent.
            TooManyLostError: With this message too many are suspected.
            DisagreementError: The sender's past is another one.
        """
        header, body = self._parsed(data)
        if header is None or header.sender not in self._heard:
            return []
        if header.sender in self.suspects:
            return []
        self._heard[header.sender] = now
        self._suspect(_numbers(header.suspects))
        if header.epoch == self._epoch:
            if header.kind == CONTENT:
                self._take_content(header, body)
            else:
                self._take_statement(header, body)
        return self._taken_events()

    def suspect(self, agent: int) -> list[Event]:
        """A member is known to be gone.

        Raises: as of `receive`.
        """
        self._suspect(frozenset({agent}) & self.members)
        return self._taken_events()

    def tick(self, now: float) -> list[Event]:
        """Repeats what others may not have received, and suspects those that were silent for too long.

        Call it several times in each `deadline`.

        Raises: as of `receive`.
        """
        waited_for = self.members - self.suspects - {self.number}
        self._suspect(
            frozenset(one for one in waited_for if now - self._heard[one] > self.deadline)
        )
        self.outbox += self._repeated
        if self._recovering:
            self.outbox.append(self._statement(STATEMENT))
        elif self.number in self._contents:
            self.outbox.append(self._content_message())
        return self._taken_events()

    def _taken_events(self) -> list[Event]:
        events, self._events = self._events, []
        return events

    def _parsed(self, data: bytes) -> tuple[Header | None, bytes]:
        if len(data) >= HEADER.size:
            header = Header(*HEADER.unpack_from(data))
            body = data[HEADER.size :]
            contents = 1 if header.kind == CONTENT else len(self.members)
            fits = len(body) == contents * self._size or header.epoch != self._epoch
            known = header.kind in (CONTENT, STATEMENT, DECISION)
            if header.magic == MAGIC and header.team == self._team and fits and known:
                return header, body
        self.refused += 1
        return None, b""

    def _take_content(self, header: Header, body: bytes) -> None:
        if self._recovering:
            return  # what is stated must not change but by statements
        if header.round == self.rounds + 1:
            self._check(header.history == self._history, header.sender)
            self._contents[header.sender] = body
            self._complete_if_all_are_there()
        elif header.round == self.rounds + 2:
            self._ahead[header.sender] = header.history, body

    def _complete_if_all_are_there(self) -> None:
        if not self._recovering and self._contents.keys() == self.members:
            self._complete(self._contents)

    def _complete(self, contents: Mapping[int, bytes]) -> None:
        if self.number in contents and not self._recovering:
            self._repeated = [self._content_message()]
        self._last = {one: contents[one] for one in sorted(self.members)}
        self._before, self.rounds = self._history, self.rounds + 1
        self._history = _digest(self._history, b"round", *self._last.values())
        self._contents = {}
        for sender, (history, body) in self._ahead.items():
            self._check(history == self._history, sender)
            self._contents[sender] = body
        self._ahead = {}
        self._events.append(RoundComplete(self._last))

    def _suspect(self, others: frozenset[int]) -> None:
        if others <= self.suspects:
            return
        if self.number in others:
            raise SuspectedError(
                f"agent {self.number} was not heard in time; the others go on without it after round {self.rounds}."
            )
        self.suspects |= others
        if len(self.suspects) > self.faults:
            raise TooManyLostError(
                f"agents {sorted(self.suspects)} are silent; the team is made for at most {self.faults}."
            )
        self._recover()

    def _recover(self) -> None:
        self._recovering = True
        self.outbox.append(self._statement(STATEMENT))
        self._decide_if_all_agree()

    def _take_statement(self, header: Header, body: bytes) -> None:
        sender, stated, decided = header.sender, _numbers(header.suspects), header.kind == DECISION
        if header.round == self.rounds + 1:
            self._check(header.history == self._history, sender)
            self._recovering = True
            self._complete(dict(zip(sorted(self.members), _parts(body, self._size), strict=True)))
            if not decided:
                self.outbox.append(self._statement(STATEMENT))
        elif header.round == self.rounds:
            same = body == self._contents_of_last_round()
            self._check(same and header.history == self._before, sender)
        elif decided or header.round > self.rounds:
            self._check(False, sender)
        if decided:
            self._decide(stated)
            return
        before = self._statements.get(sender, (0, frozenset()))
        if header.round >= before[0] and stated >= before[1]:  # they may arrive in any order
            self._statements[sender] = header.round, stated
        self._decide_if_all_agree()

    def _decide_if_all_agree(self) -> None:
        own = self.rounds, self.suspects
        others = self.members - self.suspects - {self.number}
        if self._recovering and all(self._statements.get(one) == own for one in others):
            self._decide(self.suspects)

    def _decide(self, suspects: frozenset[int]) -> None:
        lost = suspects & self.members
        decision = self._statement(DECISION, suspects)
        self.outbox.append(decision)
        self._repeated = [decision]
        self.members -= lost
        self._epoch += 1
        self._history = _digest(self._history, b"lost", bytes(sorted(lost)))
        self._last = {one: content for one, content in self._last.items() if one in self.members}
        self._contents, self._ahead, self._statements = {}, {}, {}
        self._recovering = False
        self._events.append(MembersLost(lost))
        if self.suspects & self.members:
            self._recover()

    def _check(self, same: bool, sender: int) -> None:
        if not same:
            raise DisagreementError(
                f"agents {self.number} and {sender} hold different contents of round {self.rounds} or before."
            )

    def _content_message(self) -> bytes:
        header = self._header(CONTENT, self.rounds + 1, self._history, self.suspects)
        return header + self._contents[self.number]

    def _statement(self, kind: int, suspects: frozenset[int] | None = None) -> bytes:
        stated = self.suspects if suspects is None else suspects
        return (
            self._header(kind, self.rounds, self._before, stated) + self._contents_of_last_round()
        )

    def _contents_of_last_round(self) -> bytes:
        """Those of all members; zeros before the first round."""
        return b"".join(self._last.get(one, bytes(self._size)) for one in sorted(self.members))

    def _header(self, kind: int, round_: int, history: int, suspects: frozenset[int]) -> bytes:
        mask = sum(1 << one for one in suspects)
        return HEADER.pack(MAGIC, kind, self.number, self._epoch, round_, self._team, mask, history)


@cache
def _numbers(mask: int) -> frozenset[int]:
    return frozenset(one for one in range(MAX_AGENTS) if mask >> one & 1)


def _parts(body: bytes, size: int) -> list[bytes]:
    return [body[k : k + size] for k in range(0, len(body), size)]


def _digest(history: int, *parts: bytes) -> int:
    digest = blake2b(history.to_bytes(8, "little"), digest_size=8)
    for part in parts:
        digest.update(part)
    return int.from_bytes(digest.digest(), "little")
