"""A task as the commands see it: conditions, model, generator, checks and evaluations behind declared interfaces."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

from deggflow.consistency import Line, Unverified, Wrong
from deggflow.files import StrPath
from deggflow.flow import Field
from deggflow.jsonl import read_lines

from .model import AbstractModel
from .options import EvaluateOptions, GenerateOptions, TaskOptions


@runtime_checkable
class Written(Protocol):
    """Whatever has a line in a file."""

    def to_json(self) -> Mapping[str, Any]:
        """As it stands in a file."""


@runtime_checkable
class Result(Written, Protocol):
    """What was generated for a condition, with a certificate."""

    @property
    def condition(self) -> Any:
        """What it was generated for."""


C = TypeVar("C", bound=Written)  # conditions
R = TypeVar("R", bound=Result)
Row = TypeVar("Row", bound=Written)  # of an evaluation


class Claim(NamedTuple):
    """What is said of results that are as they should be."""

    one: str
    many: str

    def of(self, count: int) -> str:
        """In the number that the count asks for."""
        return self.one if count == 1 else self.many

    def in_total(self, examinations: Sequence["Examination"]) -> str:
        """How many results hold, and of how many lines something is wrong."""
        good = sum(each.holds for each in examinations)
        wrong = sum(bool(each.wrong) for each in examinations)
        return f"{good} of {len(examinations)} {self.many}; {wrong} lines say what is not so."


class Chunking(NamedTuple):
    """How a long run is cut into pieces.

    Attributes:
        size: Conditions that are given at once; a chunk that a kill cut in two is generated again whole.
        concurrent: Whether `generate` may be called for the next chunk while the results of one are written.
    """

    size: int = 512
    concurrent: bool = False


class RunSettings(NamedTuple):
    """What decides z(0), besides a result's number among the conditions, and how often it is drawn.

    Attributes:
        seed: Of the run.
        first: Number of the first condition in the run.
        max_draws: Limit of draws; where none is satisfied the result says why.
    """

    seed: int
    first: int = 0
    max_draws: int = 1


OnStatus = Callable[[str], None]
"""Told in words how far the work is."""


class AbstractGenerator(ABC, Generic[C, R]):
    """Certified results for conditions."""

    @abstractmethod
    def chunking(self, condition: C) -> Chunking:
        """How a run whose first condition is this one is cut into pieces."""

    @abstractmethod
    def generate(
        self, conditions: Sequence[C], run: RunSettings, on_status: OnStatus
    ) -> Iterator[list[R]]:
        """Results in order, some at a time, as soon as they are finished.

        Args:
            conditions: What is asked for.
            run: What decides z(0), and how often it is drawn.
            on_status: Told how far the work is.
        """


@dataclass(frozen=True)
class Examination:
    """What `certify` found out about one line of a file, whatever the line says of itself.

    Attributes:
        holds: Whether the result satisfies its requirements.
        text: What was found, in words.
        wrong: Everything the line says that can't be so.
        certificate: The line's certificate as a table.
        detail: Whatever else the task's totals are made of.
    """

    holds: bool
    text: str
    wrong: Sequence[Wrong]
    certificate: str
    detail: Any = None


class Table(NamedTuple):
    """Rows of an evaluation as they are printed."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""  # below the table, one sentence for each column that needs it


class AbstractEvaluation(ABC, Generic[Row]):
    """Something that is measured row by row.

    Attributes:
        row: Dataclass of the rows, which files hold.
        settings: JSON values that tell this evaluation from others.
        jobs: What measures each row.
    """

    row: type[Row]
    settings: Mapping[str, Any]
    jobs: Sequence[Callable[[], Row]]

    @abstractmethod
    def tables(self, rows: Sequence[Row]) -> Sequence[Table | str]:
        """What is printed of the rows: tables, and text as it is."""

    @abstractmethod
    def complete(self, rows: Sequence[Row]) -> bool:
        """Whether everything guided is satisfied and no claim is refuted."""


class AbstractTask(ABC, Generic[C, R]):
    """Everything that `data`, `train`, `generate`, `certify`, `evaluate` and `render` need of a task.

    Attributes:
        name: On the command line.
        noun: What a result is called.
        sizes: Least and largest number of agents that `generate --size` takes.
        options: Options of the commands.
        unverified: Fields of a result's line that no file can show to be true.
    """

    name: str
    noun: str
    sizes: tuple[int, int]
    options: TaskOptions
    unverified: Unverified

    @property
    @abstractmethod
    def claim(self) -> Claim:
        """What is said of results that are as they should be."""

    @property
    @abstractmethod
    def model(self) -> AbstractModel:
        """Demonstrations, field and weights."""

    @abstractmethod
    def parse_condition(self, value: Any, field: str = "") -> C:
        """A condition from its JSON object; `InputError` with the field where it is not as it should be."""

    @abstractmethod
    def random_conditions(
        self, size: int, count: int, first: int, options: GenerateOptions
    ) -> list[C]:
        """Conditions number `first` to `first + count - 1`; each depends on the seed and its own number alone."""

    @abstractmethod
    def other_condition(self, asked: C, given: C) -> Wrong | None:
        """In what a line's condition differs from the one that was asked for."""

    @abstractmethod
    def parse_result(self, value: Any) -> R:
        """A result from its JSON object; `InputError` with the field where it is not as it should be."""

    @abstractmethod
    def generator(self, field: Field, options: GenerateOptions) -> AbstractGenerator[C, R]:
        """A generator for a field and what the options say of guidance."""

    @abstractmethod
    def examine(self, result: R, line: Line) -> Examination:
        """Checks a result by code that shares nothing with its generation, and a line against itself."""

    @abstractmethod
    def conclude(self, examinations: Sequence[Examination]) -> str:
        """The totals of some lines, in a sentence."""

    @abstractmethod
    def evaluation(
        self, field: Field, options: EvaluateOptions, weights: str | None
    ) -> AbstractEvaluation[Any]:
        """What `evaluate` measures. `weights` tells the field from others in the settings."""

    @abstractmethod
    def fails(self, row: Line, *, guided: bool) -> bool:
        """Whether a result, as it stands in a file, is not as it should be."""

    def read_conditions(self, path: StrPath) -> list[C]:
        """All conditions of a file, or `InputError` for the first that is wrong."""
        return read_lines(path, self.parse_condition, f"{self.name} condition")

    def read_results(self, path: StrPath) -> list[tuple[R, Line]]:
        """What every line of a file holds, and the line; `InputError` for the first that is wrong."""
        what = f"{self.name} {self.noun}"
        return read_lines(path, lambda line: (self.parse_result(line), line), what)


@dataclass(frozen=True)
class PictureRequest(Generic[R]):
    """One result of a file that is to be drawn.

    Attributes:
        result: The result.
        number: Its line in the file, from 1.
        options: Of `render`.
        field: Loads the field, for what has to be generated again.
        on_note: Told what is drawn otherwise than asked for, and why.
    """

    result: R
    number: int
    options: Any
    field: Callable[[], Field]
    on_note: Callable[[str], None]


class AbstractPictures(ABC, Generic[R]):
    """How a task's results are drawn."""

    @abstractmethod
    def write(self, request: PictureRequest[R]) -> Iterator[Path]:
        """Draws one result, and yields what was written.

        Raises:
            InputError: The result can't be generated again.
        """

    @abstractmethod
    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Draws what an evaluation has besides its tables, if anything is asked for."""
