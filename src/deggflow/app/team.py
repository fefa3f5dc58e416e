"""Starts one process for each agent on 127.0.0.1, and collects what they generate."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from deggflow.jsonl import InputError
from deggflow.runtime import TeamError, loopback_addresses
from deggflow.task import AbstractTask, ProcessOptions
from deggflow.task.processes import AgentFactory

from .parents import CHILD
from .runs import ConditionSource

if TYPE_CHECKING:
    from rich.progress import Progress

JOIN = 600  # s, patience of a process with others that have not started
END = 5.0  # s, for a process to end once its input is closed
SILENCE = 3.0  # times the deadline: who has said nothing for so long, once a process has failed, is frozen
_OURS = ("conditions", "size", "count", "requirements", "out", "processes", "metrics", "guidance")


class _Event(NamedTuple):
    """What a process said, or that it has ended."""

    process: int
    start: int  # how often it had been started
    line: dict[str, Any] | None


@dataclass
class _Child:
    """A started process, and where its errors go."""

    popen: subprocess.Popen[str]
    errors: IO[str]
    start: int
    reader: Thread

    def end(self) -> None:
        """Kills it, if it still runs, and closes what was open."""
        self.popen.kill()
        self.popen.wait()
        self.reader.join()
        if self.popen.stdin is not None:
            self.popen.stdin.close()
        self.errors.close()

    def last_error(self) -> str:
        self.errors.seek(0)
        lines = self.errors.read().strip().splitlines()
        return lines[-1].removeprefix("deggflow: ") if lines else ""


@dataclass(frozen=True)
class _Line:
    """A result as its agents wrote it."""

    values: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        return self.values


def team_results(
    task: AbstractTask[Any, Any], source: ConditionSource[Any], options: ProcessOptions
) -> "Callable[[int, Progress], Iterator[list[Any]]]":
    """What `generate --processes` writes: maps the number of the first result to results, one at a time.

    Raises:
        InputError: Agents of the task can't be processes.
    """
    factory = task.processes
    if factory is None:
        raise InputError(f"agents of {task.name} can't be processes; leave out --processes")
    conditions = source.part(0, source.count)
    sizes = [factory.team_size(condition, options) for condition in conditions]

    def results(first: int, bars: "Progress") -> Iterator[list[Any]]:
        if first >= source.count:
            return
        bar = bars.add_task(f"{max(sizes)} processes start", total=None)
        with ExitStack() as stack:
            view = stack.enter_context(RoundView(options.metrics, bars, bar))
            team = LocalTeam(task.name, factory, conditions, options, on_line=view.take)
            for line in stack.enter_context(team).results(first):
                yield [_Line(line)]

    return results


class RoundView:
    """Rounds as they are: a line on the screen, and JSON Lines in a file."""

    def __init__(self, path: Path | None, bars: "Progress", bar: Any) -> None:
        """Args: path: of the file, if there is one; bars, bar: where the line is shown."""
        self._path, self._bars, self._bar = path, bars, bar
        self._file: IO[str] | None = None

    def __enter__(self) -> "RoundView":
        self._file = None if self._path is None else self._path.open("w")
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def take(self, process: int, line: dict[str, Any]) -> None:
        """A line of a process."""
        if "round" not in line:
            return
        one = line["round"]
        if self._file is not None:
            self._file.write(json.dumps({"agent": process, **one}) + "\n")
        text = f"round {one['round']}, {1000 * one['seconds']:.0f} ms, {one['bytes']} bytes, {one['members']} processes"
        self._bars.update(self._bar, description=text)


class LocalTeam:
    """Processes of one run. They end with this process, however it ends.

    Attributes:
        pids: Of the agents' processes by number; the world's, if there is one, comes last.
    """

    def __init__(
        self,
        task: str,
        factory: AgentFactory,
        conditions: Sequence[Any],
        options: ProcessOptions,
        *,
        on_line: Callable[[int, dict[str, Any]], None] = lambda process, line: None,
        join: float = JOIN,
    ) -> None:
        """Args: task: its name; factory: of its agents; conditions: of all results; options: of `generate`; on_line: told what processes say; join: patience, s."""
        self._task, self._options, self._join, self._on_line = task, options, join, on_line
        self._agents = max(factory.team_size(condition, options) for condition in conditions)
        self._world = options.in_world
        self._count, self._silence = len(conditions), SILENCE * options.deadline + END
        self._folder = tempfile.TemporaryDirectory(prefix="deggflow-")
        self._file = Path(self._folder.name) / "conditions.jsonl"
        lines = (json.dumps(condition.to_json()) + "\n" for condition in conditions)
        self._file.write_text("".join(lines))
        self._addresses = loopback_addresses(options.transport, self._agents + self._world)
        self._events: SimpleQueue[_Event] = SimpleQueue()
        self._children: dict[int, _Child] = {}

    @property
    def pids(self) -> list[int]:
        """Process identifiers by number."""
        return [self._children[k].popen.pid for k in sorted(self._children)]

    def results(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Results from a number on, as JSON objects, in order. Agents that were lost are started again for the next one.

        Raises:
            TeamError: No agent is left, or only frozen ones, or two agents have different results.
        """
        for k in range(self._agents + self._world):
            self._start(k, first)
        made: dict[int, dict[str, Any]] = {}
        for number in range(first, self._count):
            while number not in made:
                self._take(self._next_event(), made)
            result = made[number]
            yield result["result"]
            for k in result["lost"] if number + 1 < self._count else ():
                self._children[k].end()
                self._start(k, number + 1)
        self._hear_the_others(made)

    def _next_event(self) -> _Event:
        while True:
            with suppress(Empty):
                return self._events.get(timeout=self._silence)
            failed = [
                k for k in range(self._agents) if self._children[k].popen.poll() not in (None, 0)
            ]
            if failed:
                raise TeamError(
                    f"nothing is heard of the other processes since number {failed[0]} ended; it says: {self._children[failed[0]].last_error()}"
                )

    def _hear_the_others(self, made: dict[int, dict[str, Any]]) -> None:
        """Compares the last results of all agents, which end by themselves; those that are frozen are not waited for."""
        end = time.monotonic() + END
        while time.monotonic() < end and any(
            self._children[k].popen.poll() is None for k in range(self._agents)
        ):
            with suppress(Empty):
                self._take(self._events.get(timeout=0.1), made)

    def _take(self, event: _Event, made: dict[int, dict[str, Any]]) -> None:
        process, start, line = event
        if line is None:
            self._note_end(process, start)
            return
        self._on_line(process, line)
        if "result" not in line:
            return
        known = made.setdefault(line["number"], line)
        if known != line:
            raise TeamError(f"agents have different results number {line['number']}.")

    def _note_end(self, process: int, start: int) -> None:
        child = self._children[process]
        if child.start != start:
            return
        child.popen.wait()
        agents = [self._children[k] for k in range(self._agents)]
        if all(each.popen.poll() not in (None, 0) for each in agents):
            raise TeamError(f"no agent is left; the last one says: {child.last_error()}")

    def _start(self, number: int, first: int) -> None:
        start = self._children[number].start + 1 if number in self._children else 0
        errors = tempfile.TemporaryFile("w+")  # noqa: SIM115
        popen = subprocess.Popen(
            self._command(number, first), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=errors, text=True, start_new_session=True, env={**os.environ, CHILD: "1"},
        )  # fmt: skip
        reader = Thread(target=self._read, args=(number, start, popen), daemon=True)
        self._children[number] = _Child(popen, errors, start, reader)
        reader.start()

    def _command(self, number: int, first: int) -> list[str]:
        what = "world" if number == self._agents else "agent"
        words = [sys.executable, "-m", "deggflow.app.start", "run", what, self._task]
        words += ["--number", str(number), "--first", str(first), "--join", str(self._join)]
        words += ["--addresses", *self._addresses, "--conditions", str(self._file)]
        if self._options.processes:
            words += ["--processes", str(self._options.processes)]
        for field in fields(self._options):
            value, option = getattr(self._options, field.name), f"--{field.name.replace('_', '-')}"
            if field.name in _OURS or value in (None, False):
                continue
            words += [option] if value is True else [option, str(value)]
        return words

    def _read(self, number: int, start: int, popen: subprocess.Popen[str]) -> None:
        assert popen.stdout is not None
        with popen.stdout:
            for text in popen.stdout:
                try:
                    self._events.put(_Event(number, start, json.loads(text)))
                except ValueError:  # cut off by its end
                    break
        self._events.put(_Event(number, start, None))

    def __enter__(self) -> "LocalTeam":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:  # fmt: skip
        """Ends all processes."""
        for child in self._children.values():
            child.end()
        self._folder.cleanup()
