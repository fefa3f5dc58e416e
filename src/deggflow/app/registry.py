"""The available tasks: the package's own, and those that other packages register.

A package registers a task in one line of its pyproject.toml:

    [project.entry-points."deggflow.tasks"]
    drones = "drones:DroneTask"

A task that is not a team task also registers its pictures, under the same name in "deggflow.pictures".
"""

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from deggflow.jsonl import InputError
from deggflow.task import TaskOptions

if TYPE_CHECKING:
    from deggflow.task import AbstractPictures, AbstractTask

GROUP, PICTURES = "deggflow.tasks", "deggflow.pictures"


class AbstractEntry(ABC):
    """Loads a task and its parts.

    Attributes:
        name: The task's name on the command line.
        help: One sentence on its results.
    """

    name: str
    help: str

    @property
    @abstractmethod
    def noun(self) -> str:
        """The task's word for one result."""

    @abstractmethod
    def load_options(self) -> TaskOptions:
        """The dataclasses of the task's options."""

    @abstractmethod
    def load_lines(self) -> Sequence[type[Any]]:
        """Types of the lines of the task's files."""

    @abstractmethod
    def load_task(self) -> "AbstractTask[Any, Any]":
        """The task; raises `InputError` if it can't be loaded."""

    @abstractmethod
    def load_pictures(self) -> "AbstractPictures[Any]":
        """The pictures of its results."""


@dataclass(frozen=True)
class ShippedEntry(AbstractEntry):
    """A task of this package; its objects are imported when they are needed.

    Attributes:
        name: The task's name on the command line.
        help: One sentence on its results.
        result: The task's word for one result.
        options: "module:object" of its `TaskOptions`, which are read before JAX is loaded.
        lines: "module:object" of the types of its lines, likewise.
        task: "module:class" of its `AbstractTask`.
        pictures: "module:class" of its `AbstractPictures`.
        episodes: Module with `format_of` and `episode`, if its results are episodes of a LeRobot data set.
    """

    name: str
    help: str
    result: str
    options: str
    lines: str
    task: str
    pictures: str
    episodes: str | None = None

    @property
    def noun(self) -> str:
        """The task's word for one result."""
        return self.result

    def load_options(self) -> TaskOptions:
        """The dataclasses of the task's options."""
        options: TaskOptions = _object(self.options)
        return options

    def load_lines(self) -> Sequence[type[Any]]:
        """Types of the lines of the task's files."""
        lines: Sequence[type[Any]] = _object(self.lines)
        return lines

    def load_task(self) -> "AbstractTask[Any, Any]":
        """The task."""
        task: AbstractTask[Any, Any] = _object(self.task)()
        return task

    def load_pictures(self) -> "AbstractPictures[Any]":
        """The pictures of its results."""
        pictures: AbstractPictures[Any] = _object(self.pictures)()
        return pictures


SHIPPED = (
    ShippedEntry(
        "tabletop",
        "Scenes of objects on a table, each easy to reach and use.",
        "scene",
        "deggflow.tasks.tabletop.options:OPTIONS",
        "deggflow.tasks.tabletop.lines:LINES",
        "deggflow.tasks.tabletop.task:TabletopTask",
        "deggflow.view.tabletop.results:TabletopPictures",
    ),
    ShippedEntry(
        "bridge",
        "Robots push a plank over a gap and cross it.",
        "trial",
        "deggflow.tasks.bridge.options:OPTIONS",
        "deggflow.tasks.bridge.lines:LINES",
        "deggflow.tasks.bridge.task:BridgeTask",
        "deggflow.view.bridge.results:BridgePictures",
        "deggflow.tasks.bridge.lerobot",
    ),
    ShippedEntry(
        "fleet",
        "Paths of robots that share a floor, clear of obstacles and of each other.",
        "plan",
        "deggflow.tasks.fleet.options:OPTIONS",
        "deggflow.tasks.fleet.lines:LINES",
        "deggflow.tasks.fleet.task:FleetTask",
        "deggflow.view.fleet.results:FleetPictures",
        "deggflow.tasks.fleet.lerobot",
    ),
)


def _object(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


class RegisteredEntry(AbstractEntry):
    """A task that another package registers. It is imported as a whole, including JAX."""

    def __init__(self, point: EntryPoint) -> None:
        """Args: point: the entry point in the other package's metadata."""
        self.point, self.name = point, point.name
        self.help = f"A task from {point.module}."

    @property
    def noun(self) -> str:
        """The task's word for one result."""
        return self.load_task().noun

    def load_options(self) -> TaskOptions:
        """The dataclasses of the task's options."""
        return self.load_task().options

    def load_lines(self) -> Sequence[type[Any]]:
        """Types of the lines of the task's files."""
        return self.load_task().formats.lines

    def load_task(self) -> "AbstractTask[Any, Any]":
        """The task; raises `InputError` if it can't be loaded."""
        try:
            task: AbstractTask[Any, Any] = self.point.load()()
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"the task {self.name!r}, registered as {self.point.value!r}, can't be loaded: {error}"
            ) from None
        return task

    def load_pictures(self) -> "AbstractPictures[Any]":
        """Pictures by the `draw` method of a team task; for any other task, those registered under its name."""
        from deggflow.task.team import AbstractTeamTask
        from deggflow.view.team import TeamPictures

        task = self.load_task()
        if isinstance(task, AbstractTeamTask):
            return TeamPictures(task)
        for point in entry_points(group=PICTURES, name=self.name):
            pictures: AbstractPictures[Any] = point.load()()
            return pictures
        raise InputError(f"no pictures are registered for {self.name!r} in the group {PICTURES!r}")


def registered(shipped: Sequence[str]) -> list[RegisteredEntry]:
    """Tasks of other packages, except those that have the name of a shipped task."""
    return [
        RegisteredEntry(point) for point in entry_points(group=GROUP) if point.name not in shipped
    ]


def entry_named(name: str) -> AbstractEntry:
    """The entry of a task; raises `InputError` if there is none of this name."""
    entries: list[AbstractEntry] = [*SHIPPED, *registered([entry.name for entry in SHIPPED])]
    for entry in entries:
        if entry.name == name:
            return entry
    known = ", ".join(entry.name for entry in entries)
    raise InputError(f"--task: there is no task {name!r}; known are {known}")
