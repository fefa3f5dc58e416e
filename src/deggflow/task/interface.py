"""The interfaces of a task that the commands use: conditions, model, generator, checks and evaluations."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from deggflow.consistency import Line, Wrong
from deggflow.files import StrPath
from deggflow.flow import Field
from deggflow.jsonl import read_lines
from deggflow.tables import read_results

from .formats import C, Formats, R, Written
from .model import AbstractModel
from .options import EvaluateOptions, GenerateOptions, TaskOptions

if TYPE_CHECKING:
    from .processes import AgentFactory

Row = TypeVar("Row", bound=Written)  # rows of an evaluation


class Claim(NamedTuple):
    """How `generate` describes results that satisfy their requirements.

    Attributes:
        one: Singular, e.g. "scene satisfies every requirement".
        many: Plural.
    """

    one: str
    many: str

    def of(self, count: int) -> str:
        """The singular or the plural, by the count."""
        return self.one if count == 1 else self.many

    def in_total(self, examinations: Sequence["Examination"]) -> str:
        """A sentence with the numbers of satisfied results and of lines with false statements."""
        satisfied = sum(each.holds for each in examinations)
        wrong = sum(bool(each.wrong) for each in examinations)
        return f"{satisfied} of {len(examinations)} {self.many}; {wrong} lines contain false statements."


class Chunking(NamedTuple):
    """How a long run is divided into chunks.

    Attributes:
        size: Conditions per chunk; a chunk that a kill cut in two is generated again as a whole.
        concurrent: Whether `generate` may be called for the next chunk while the results of one are written.
    """

    size: int = 512
    concurrent: bool = False


class RunSettings(NamedTuple):
    """Settings of a run that, with a result's number, determine z(0) and the number of draws.

    Attributes:
        seed: Seed of the run.
        first: Number of the first condition in the run.
        max_draws: Limit of draws; if none is satisfied, the result states the reason.
    """

    seed: int
    first: int = 0
    max_draws: int = 1


OnStatus = Callable[[str], None]
"""Called with a text on the progress."""


class AbstractGenerator(ABC, Generic[C, R]):
    """Generates certified results for conditions."""

    @abstractmethod
    def chunking(self, condition: C) -> Chunking:
        """How a run that starts with this condition is divided into chunks."""

    @abstractmethod
    def generate(
        self, conditions: Sequence[C], run: RunSettings, on_status: OnStatus
    ) -> Iterator[list[R]]:
        """Yields results in order, some at a time, as soon as they are finished.

        Args:
            conditions: One condition per result.
            run: Seed of z(0), first number and limit of draws.
            on_status: Called with a text on the progress.
        """


@dataclass(frozen=True)
class Examination:
    """The findings of `certify` on one line of a file, independent of the line's own claims.

    Attributes:
        holds: Whether the result satisfies its requirements.
        text: The findings in words.
        wrong: The false statements of the line.
        certificate: The line's certificate as a table.
        detail: Further values for the task's totals.
    """

    holds: bool
    text: str
    wrong: Sequence[Wrong]
    certificate: str
    detail: Any = None

    @classmethod
    def of_verdict(
        cls, holds: bool, reason: str | None, least: str, wrong: Sequence[Wrong], certificate: str
    ) -> "Examination":
        """Of a verdict that is made anew.

        Args:
            holds: Whether the result satisfies its requirements.
            reason: Why it does not.
            least: The least margin with its unit.
            wrong: The false statements of the line.
            certificate: The line's certificate as a table.
        """
        text = "now it holds" if holds else f"now it does NOT hold: {reason}"
        return cls(holds, f"{text} (least margin {least})", wrong, certificate)


class Table(NamedTuple):
    """A printed table of an evaluation.

    Attributes:
        title: Text above the table.
        headings: One per column.
        rows: Cells.
        note: Text below the table, which explains columns.
    """

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""


class AbstractEvaluation(ABC, Generic[Row]):
    """An evaluation that is measured row by row.

    Attributes:
        row: Dataclass of the rows, which files hold.
        settings: JSON values that distinguish this evaluation from others.
        jobs: One function per row, which measures it.
    """

    row: type[Row]
    settings: Mapping[str, Any]
    jobs: Sequence[Callable[[], Row]]

    @abstractmethod
    def tables(self, rows: Sequence[Row]) -> Sequence[Table | str]:
        """Tables and plain texts that present the rows."""

    @abstractmethod
    def complete(self, rows: Sequence[Row]) -> bool:
        """Whether all guided results satisfy their requirements and no claim is refuted."""


class AbstractTask(ABC, Generic[C, R]):
    """A task, as `data`, `train`, `generate`, `certify`, `evaluate` and `render` use it.

    Attributes:
        name: The task's name on the command line.
        noun: The task's word for one result.
        sizes: Least and largest number of agents that `generate --size` takes.
        options: Options of the commands.
        processes: How its agents are processes; None if they can't be.
    """

    name: str
    noun: str
    sizes: tuple[int, int]
    options: TaskOptions
    processes: "AgentFactory | None" = None

    @property
    def claim(self) -> Claim:
        """How results that satisfy their requirements are described: as that, by the task's noun."""
        return Claim(
            f"{self.noun} satisfies every requirement", f"{self.noun}s satisfy every requirement"
        )

    @property
    @abstractmethod
    def formats(self) -> Formats[C, R]:
        """How its conditions and results stand in files."""

    @property
    @abstractmethod
    def model(self) -> AbstractModel:
        """Demonstrations, field and weights."""

    @abstractmethod
    def random_conditions(
        self, size: int, count: int, first: int, options: GenerateOptions
    ) -> list[C]:
        """Conditions number `first` to `first + count - 1`; each depends on the seed and its own number alone."""

    @abstractmethod
    def generator(self, field: Field, options: GenerateOptions) -> AbstractGenerator[C, R]:
        """A generator with this field, guided or not as the options say."""

    @abstractmethod
    def examine(self, result: R, line: Line) -> Examination:
        """Checks a result by code that is independent of its generation, and its line against itself."""

    @abstractmethod
    def evaluation(
        self, field: Field, options: EvaluateOptions, weights: str | None
    ) -> AbstractEvaluation[Any]:
        """The evaluation that `evaluate` runs; `weights` identifies the field in its settings."""

    def conclude(self, examinations: Sequence[Examination]) -> str:
        """A sentence with the totals over some lines: those that hold, and those with a false statement."""
        return self.claim.in_total(examinations)

    def fails(self, row: Line, *, guided: bool) -> bool:
        """Whether a result, as a JSON object, fails: its certificate says that a requirement is missed."""
        return not row["certificate"]["satisfied"]

    def parse_condition(self, value: Any, field: str = "") -> C:
        """A condition from its JSON object; raises `InputError` naming the field if it is invalid."""
        return self.formats.condition(value, field)

    def parse_result(self, value: Any) -> R:
        """A result from its JSON object; raises `InputError` naming the field if it is invalid."""
        return self.formats.result(value)

    def read_conditions(self, path: StrPath) -> list[C]:
        """All conditions of a file; raises `InputError` for the first invalid one."""
        return read_lines(path, self.parse_condition, f"{self.name} condition")

    def read_results(self, path: StrPath) -> list[tuple[R, Line]]:
        """The results of a JSON Lines file or a table, each with its line; raises `InputError` for the first invalid one."""
        what = f"{self.name} {self.noun}"
        lines = self.formats.lines
        return read_results(path, lambda line: (self.parse_result(line), line), what, lines)


@dataclass(frozen=True)
class PictureRequest(Generic[R]):
    """A request to draw one result of a file.

    Attributes:
        result: The result.
        number: Its line in the file, from 1.
        options: Options of `render`.
        field: Loads the field, if the result has to be generated again.
        on_note: Called with a message if something can't be drawn as requested.
    """

    result: R
    number: int
    options: Any
    field: Callable[[], Field]
    on_note: Callable[[str], None]


class AbstractPictures(ABC, Generic[R]):
    """Draws a task's results."""

    @abstractmethod
    def write(self, request: PictureRequest[R]) -> Iterator[Path]:
        """Draws one result and yields the files written.

        Raises:
            InputError: The result can't be generated again.
        """

    @abstractmethod
    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Draws the figures of an evaluation that the options select, if any."""
