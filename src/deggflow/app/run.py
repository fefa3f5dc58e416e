"""`deggflow run agent` and `deggflow run world`: one process of a team, on this machine or another."""

import json
import os
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.extras import SubcommandApp

from deggflow.jsonl import InputError
from deggflow.task import ProcessOptions, check_range

from .parents import CHILD
from .registry import SHIPPED, AbstractEntry
from .session import SATISFIED, UNFORESEEN, cache_folder, prepare_jax

if TYPE_CHECKING:
    from deggflow.runtime import RoundStatistics, Timing, Transport
    from deggflow.task import AbstractTask
    from deggflow.task.processes import AgentFactory, WorldFactory

_INLINE = tyro.conf.arg(name="", prefix_name=False)


@dataclass(frozen=True)
class Place:
    """Which process of the team this is, and where the others are.

    Attributes:
        number: Of this process: agents from 0, then the world if the task has one.
        addresses: Of all processes by number, the same for all: HOST:PORT for udp, PROTOCOL/HOST:PORT for zenoh.
        zenoh_config: File of zenoh's own settings (JSON5): TLS, access control.
        faults: How many agents may be lost (default: fewer than half of the team).
        join: Seconds to wait for processes that have not started.
        first: Number of the first result to take part in, from 0.
    """

    number: int
    addresses: tuple[str, ...]
    zenoh_config: Path | None = None
    faults: int | None = None
    join: float = 300.0
    first: int = 0

    @property
    def child(self) -> bool:
        """Whether `generate --processes` started this process, with which it ends."""
        return CHILD in os.environ

    def __post_init__(self) -> None:
        check_range("number", self.number, 0, len(self.addresses) - 1)
        check_range("join", self.join, 1, 86_400, "s")


def run_app() -> SubcommandApp:
    """`run agent TASK` and `run world TASK`, for tasks whose agents can be processes."""
    app, agents, worlds = SubcommandApp(), SubcommandApp(), SubcommandApp()
    for entry in SHIPPED:
        kind = entry.load_options().generate
        if not issubclass(kind, ProcessOptions):
            continue
        agents.command(name=entry.name, help=entry.help)(_with(kind, _agent(entry)))
        if kind.in_world:
            worlds.command(name=entry.name, help=entry.help)(_with(kind, _world(entry)))
    app.command(agents, name="agent", help="One agent of a team; prints its results.")
    app.command(worlds, name="world", help="The world in which a team acts.")
    return app


def _with(kind: type[Any], command: Callable[..., int]) -> Callable[..., int]:
    command.__annotations__["place"] = Annotated[Place, _INLINE]
    command.__annotations__["options"] = Annotated[kind, _INLINE]
    return command


def _agent(entry: AbstractEntry) -> Callable[..., int]:
    def agent(place: Place, options: Any) -> int:
        """Take part in the results of a team as one of its agents, and print each as a JSON object.

        All agents are given the same conditions, seed and options. Exit code 0: all results were made; 1: the team went
        on without this agent, or never came together; 2: bad input.

        Args:
            place: Which agent this is.
            options: What to generate, and how.
        """

        def play(
            task: "AbstractTask[Any, Any]", factory: "AgentFactory", context: _Context
        ) -> None:
            from deggflow.task import RunSettings
            from deggflow.task.processes import Link

            link = Link(
                place.number, context.transport, context.timing, place.faults,
                on_round=context.on_round, compiling=context.compiling,
            )  # fmt: skip
            agent = factory.agent(task.model.load(options.weights), options, link)
            for number, condition in context.conditions:
                made = agent.make(condition, RunSettings(options.seed, number, options.max_draws))
                if made is None:
                    continue
                line = made.result.to_json()
                if place.child:
                    line = {"number": number, "lost": sorted(made.lost), "result": line}
                print(json.dumps(line, allow_nan=False), flush=True)

        return _played(entry, place, options, play)

    return agent


def _world(entry: AbstractEntry) -> Callable[..., int]:
    def world(place: Place, options: Any) -> int:
        """Be the world in which a team acts: it moves the plank as the robots command.

        Args:
            place: Where the robots are; the world's address comes last.
            options: The same conditions and seed as of the robots.
        """

        def play(task: Any, factory: "WorldFactory", context: _Context) -> None:
            if place.number != len(place.addresses) - 1:
                raise InputError(
                    f"--number of the world must be {len(place.addresses) - 1}, the last; got {place.number}"
                )
            for number, condition in context.conditions:
                factory.run_world(condition, number, context.transport, context.timing)

        return _played(entry, place, options, play)

    return world


@dataclass(frozen=True)
class _Context:
    """What a process needs besides its task."""

    transport: "Transport"
    timing: "Timing"
    conditions: list[tuple[int, Any]]
    on_round: "Callable[[RoundStatistics], None]"
    compiling: Callable[[], AbstractContextManager[Any]]


def _played(
    entry: AbstractEntry, place: Place, options: ProcessOptions, play: Callable[..., None]
) -> int:
    """Opens the transport, plays, and closes it; what a team can't do is one line and exit code 1."""
    if place.child:
        from .parents import end_with_parent

        end_with_parent()
    if options.out is not None or options.processes == 0:
        raise InputError(
            "--out and --processes without a number are of generate; a single process prints its results"
        )
    prepare_jax()
    from deggflow.runtime import TeamError, Timing, open_transport

    from .runs import condition_source

    task = entry.load_task()
    source = condition_source(task, options)
    conditions = source.part(0, source.count)
    factory = task.processes
    assert factory is not None
    agents = max(factory.team_size(condition, options) for condition in conditions)
    agents += options.in_world
    if len(place.addresses) != agents:
        of_agents = "processes" if options.processes else "objects"
        whom = "robots and the world" if options.in_world else of_agents
        raise InputError(
            f"--addresses must be those of all {agents} {whom}; got {len(place.addresses)}"
        )
    timing = Timing(options.deadline, min(0.1, options.deadline / 10), place.join)
    try:
        transport = open_transport(
            options.transport, place.number, place.addresses, place.zenoh_config
        )
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from None
    context = _Context(
        transport, timing, list(enumerate(conditions))[place.first :],
        _tell if place.child else _nothing, _one_at_a_time if place.child else nullcontext,
    )  # fmt: skip
    try:
        play(task, factory, context)
    except TeamError as error:
        print(f"deggflow: {error}", file=sys.stderr)
        return UNFORESEEN
    finally:
        transport.close()
    return SATISFIED


def _nothing(_: "RoundStatistics") -> None:
    """Tells nobody."""


def _tell(statistics: "RoundStatistics") -> None:
    print(json.dumps({"round": statistics._asdict()}), flush=True)


def _one_at_a_time() -> AbstractContextManager[Any]:
    """The first process compiles, the others read what it has compiled."""
    from filelock import FileLock

    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return nullcontext()
    return FileLock(folder / ".compiling.lock")
