"""An agent as a member of its team: messages and times in, messages out."""

from collections.abc import Iterable
from hashlib import blake2b

import numpy as np

from deggflow.identity import fingerprint, requirement_numbers

from .agent import Agent, TeamGeneration
from .agreement import Agreement, Event, RoundComplete
from .program import AgentProgram, Start


def team_digest(program: AgentProgram, start: Start) -> int:
    """64 bits that tell a generation from others: z(0), grid, who was lost before, condition and requirements."""
    digest = blake2b(digest_size=8)
    condition = fingerprint(start.condition, start.z0.dtype)
    numbers = requirement_numbers(program.guidance.requirements)
    for part in (start.z0, start.grid, start.stops, condition, numbers):
        digest.update(np.ascontiguousarray(part).tobytes())
    return int.from_bytes(digest.digest(), "little")


class Member:
    """Carries one agent through the rounds of its team, whatever delivers the messages.

    Attributes:
        agent: What it computes.
        agreement: What the team agrees on.
        released: Whether all others have the sample too, and need nothing more from this agent.
    """

    def __init__(
        self,
        program: AgentProgram,
        number: int,
        start: Start,
        *,
        faults: int,
        deadline: float,
        now: float = 0.0,
    ) -> None:
        """A member of a team whose agents have all started.

        Args:
            program: Of the team.
            number: Of this agent.
            start: `program.start(z0, condition)`.
            faults: How many agents may be lost. With fewer than half of the team, no two parts of a team that is cut
                in two can both go on.
            deadline: Seconds of silence after which an agent is lost.
            now: The time.

        Raises:
            ValueError: A number does not fit.
        """
        self.agent, self.released = Agent(program, number, start), False
        absent = set(range(len(start.z0))) - set(start.present)
        self.agreement = Agreement(
            number, len(start.z0), team=team_digest(program, start), size=self.agent.layout.size,
            faults=faults, deadline=deadline, now=now, absent=absent,
        )  # fmt: skip

    @property
    def generated(self) -> TeamGeneration | None:
        """The sample, once it is certain that all agents have it."""
        return self.agent.generated

    def start(self) -> None:
        """Takes part in the first round."""
        self._follow(self.agreement.publish(self.agent.first_message()))

    def receive(self, data: bytes, now: float) -> None:
        """Takes a message of another agent.

        Raises:
            TeamError: The agent can't go on as a member of its team.
        """
        self._follow(self.agreement.receive(data, now))

    def tick(self, now: float) -> None:
        """Repeats messages and looks for agents that have fallen silent; to be called several times in a deadline.

        Raises:
            TeamError: The agent can't go on as a member of its team.
        """
        self._follow(self.agreement.tick(now))

    def suspect(self, agent: int) -> None:
        """An agent is known to be gone.

        Raises:
            TeamError: The agent can't go on as a member of its team.
        """
        self._follow(self.agreement.suspect(agent))

    def sent(self) -> list[bytes]:
        """Messages to all other agents, since the last call."""
        messages, self.agreement.outbox = self.agreement.outbox, []
        return messages

    def _follow(self, events: Iterable[Event]) -> None:
        """Answers events until there are none."""
        pending = list(events)
        while pending:
            answer = b""
            for event in pending:
                self.released |= self.generated is not None and isinstance(event, RoundComplete)
                if isinstance(event, RoundComplete):
                    answer = self.agent.next_message(event.contents)
                else:
                    answer = self.agent.message_without(event.lost)
            if self.released:
                return  # what others may still need is repeated; another round would only be answered by one
            # Of several events the last one counts: after a loss, what was to be said before it is void.
            pending = self.agreement.publish(answer)
