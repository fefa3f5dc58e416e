"""What a task implements so that each of its agents can be a process."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from deggflow.runtime import RoundStatistics, Timing, Transport

from .formats import Written
from .interface import RunSettings

C = TypeVar("C", bound=Written)


@dataclass(frozen=True)
class Link:
    """What one agent's process is given of its team.

    Attributes:
        number: Of the agent.
        transport: To the others.
        timing: Deadline, repetitions and patience.
        faults: How many agents may be lost; fewer than half of the team if None.
        on_round: Told of every round.
        compiling: Entered while programs are compiled, so that processes of one machine can do so one after the other.
    """

    number: int
    transport: Transport
    timing: Timing
    faults: int | None = None
    on_round: Callable[[RoundStatistics], None] = lambda statistics: None
    compiling: Callable[[], AbstractContextManager[Any]] = nullcontext

    def faults_of(self, members: int) -> int:
        """How many agents of a team may be lost."""
        return (members - 1) // 2 if self.faults is None else min(self.faults, members - 1)


class Made(NamedTuple):
    """A result that a team has generated, each agent by itself.

    Attributes:
        result: As `generate` writes it.
        lost: Numbers of the agents that were lost on the way.
    """

    result: Any
    lost: frozenset[int]


class AbstractAgent(ABC, Generic[C]):
    """One agent of a task, which takes part in one result after the other."""

    @abstractmethod
    def make(self, condition: C, run: RunSettings) -> Made | None:
        """Takes part in the result number `run.first`; None if this agent has no part in it.

        Raises:
            TeamError: The agent can't go on as a member of its team.
        """


class AgentFactory(ABC):
    """A task whose agents can be processes has this as `processes`."""

    @abstractmethod
    def team_size(self, condition: Any, options: Any) -> int:
        """How many processes generate for a condition; raises `InputError` if they can't."""

    @abstractmethod
    def agent(self, field: Any, options: Any, link: Link) -> AbstractAgent[Any]:
        """An agent with its copy of the field."""


class WorldFactory(AgentFactory):
    """A task whose team acts in a world, as `in_world` of its options says, has this as `processes`."""

    @abstractmethod
    def run_world(self, condition: Any, number: int, transport: Transport, timing: Timing) -> None:
        """The world of one result, until it is over."""
