"""Options of the commands that every task has; a task derives from these to add its own. Does not import JAX."""

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import tyro

from deggflow.jsonl import InputError

MAX_COUNT = 1_000_000
MAX_RESULTS = 1_000_000_000  # of one run of `generate`, for instance in shards
MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers
MAX_DRAWS = 10_000

Phase = Literal["during", "after"]
"""When guidance acts: throughout the generation, or after it, on the nominal sample."""


def check_range(
    name: str, value: int | float, low: int | float, high: int | float, unit: str = ""
) -> None:
    """Raises `InputError`, with the option's name on the command line, if its value lies outside its range."""
    if not low <= value <= high:
        unit = unit and f" {unit}"
        raise InputError(
            f"--{name.replace('_', '-')} must lie in [{low}, {high}]{unit}; got {value}"
        )


@dataclass(frozen=True)
class Recipe:
    """Which demonstrations to make.

    Attributes:
        training: Training demonstrations of each size.
        validation: Validation demonstrations of each size.
        seed: Seed of the demonstrations.
        sizes: Sizes of the teams.

    Raises:
        InputError: A setting lies outside its range.
    """

    training: int = 4_000
    validation: int = 400
    seed: int = 0
    sizes: tuple[int, ...] = (4, 5, 6)

    def __post_init__(self) -> None:
        check_range("training", self.training, 1, MAX_COUNT)
        check_range("validation", self.validation, 1, MAX_COUNT)
        check_range(
            "seed", self.seed, 0, MAX_SEED // 2
        )  # training and validation seeds derive from it
        if not self.sizes or len(set(self.sizes)) < len(self.sizes):
            raise InputError(
                f"--sizes must be one size or several different ones; got {self.sizes}"
            )

    def to_json(self) -> dict[str, Any]:
        """The JSON object beside the data and in cards."""
        return {**asdict(self), "sizes": list(self.sizes)}


@dataclass(frozen=True)
class TrainOptions:
    """How to train a field; fields that a task adds are sizes of its network.

    Attributes:
        steps: Training steps, a multiple of 500. Steps added to a finished run have their own warm-up and cosine schedule.
        batch: Samples in a training step.
        learning_rate: Peak of the cosine schedule.
        seed: Seed of initial weights, batches and noise.
    """

    steps: int = 50_000
    batch: int = 256
    learning_rate: float = 1.5e-3
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in self.architecture().items():
            check_range(name, value, 1, 10_000)
        check_range("seed", self.seed, 0, MAX_SEED)
        check_range("batch", self.batch, 1, 100_000)
        if not 0 < self.learning_rate < 1:
            raise InputError(f"--learning-rate must lie in (0, 1); got {self.learning_rate}")

    def architecture(self) -> dict[str, int]:
        """Sizes of the network by name."""
        common = {field.name for field in fields(TrainOptions)}
        return {name: value for name, value in asdict(self).items() if name not in common}


@dataclass(frozen=True)
class MessagePassingOptions(TrainOptions):
    """How to train a message-passing field.

    Attributes:
        width: Width of the message-passing layers.
        rounds: Rounds of messages.
        head_width: Width of the last layers.
    """

    width: int = 128
    rounds: int = 2
    head_width: int = 256


@dataclass(frozen=True)
class FieldOptions:
    """How often the field is evaluated, and when guidance acts.

    Attributes:
        evaluations: How often a generation evaluates the field.
        guidance_phase: during: guidance acts throughout the generation; after: on the nominal sample at its end.
    """

    most_evaluations: ClassVar[int] = 100

    evaluations: int = 16
    guidance_phase: Phase = "during"

    def __post_init__(self) -> None:
        check_range("evaluations", self.evaluations, 1, self.most_evaluations)


@dataclass(frozen=True)
class GenerateOptions(FieldOptions):
    """What to generate, and how.

    Attributes:
        conditions: File of conditions, one JSON object a line.
        size: Number of agents of randomly drawn conditions, instead of a file.
        count: Number of conditions to draw with --size (default 1).
        seed: Seed of drawn conditions and of z(0).
        out: File that receives the results, line by line; rerun the command to resume. Default: stdout.
        guidance: degg: guided; none: only the nominal field, with one draw.
        max_draws: Limit of draws of a result that does not satisfy its requirements.
        weights: Another weights file (.safetensors, card beside it).
    """

    conditions: Path | None = None
    size: int | None = None
    count: int | None = None
    seed: int = 0
    out: Path | None = None
    guidance: Literal["degg", "none"] = "degg"
    max_draws: int = 8
    weights: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("max-draws", self.max_draws, 1, MAX_DRAWS)
        check_range("seed", self.seed, 0, MAX_SEED)

    @property
    def guided(self) -> bool:
        """Whether the results are guided."""
        return self.guidance == "degg"

    def settings(self) -> dict[str, Any]:
        """JSON values by name that distinguish runs, besides conditions and weights."""
        elsewhere = ("conditions", "size", "count", "out", "weights")
        return {name: value for name, value in asdict(self).items() if name not in elsewhere}


def _number_of_processes(arguments: list[str]) -> int:
    if len(arguments) > 1:
        raise ValueError(f"--processes takes one number at most; got {' '.join(arguments)}")
    return int(arguments[0]) if arguments else 0


OptionalNumber = Annotated[
    int | None,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs="*",
        metavar="[K]",
        instance_from_str=_number_of_processes,
        is_instance=lambda value: value is None or isinstance(value, int),
        str_from_instance=lambda value: ["none"] if value is None else [str(value)],
    ),
]
"""An option whose number may be left out: 0 then, and None without the option."""

MAX_PROCESSES = 64


@dataclass(frozen=True)
class ProcessOptions(GenerateOptions):
    """Whether each agent is a process, and how processes talk.

    Attributes:
        processes: Every agent is a process of its own on 127.0.0.1; with a number, so many processes share a large team.
            Results are as without.
        transport: With --processes: datagrams of the operating system, or zenoh (extra deggflow[runtime]).
        deadline: With --processes: seconds of silence after which an agent is lost.
        metrics: With --processes: file that receives a JSON object for every round of every agent.
    """

    in_world: ClassVar[bool] = False
    """Whether the team acts in a world, which is one more process."""

    processes: OptionalNumber = None
    transport: Literal["udp", "zenoh"] = "udp"
    deadline: float = 5.0
    metrics: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("deadline", self.deadline, 0.5, 3600, "s")
        if self.processes:
            check_range("processes", self.processes, 2, MAX_PROCESSES)
        if self.processes is not None and not self.guided:
            raise InputError("--processes goes with --guidance degg; nominal samples need no team")
        if self.metrics is not None and self.processes is None:
            raise InputError("--metrics goes with --processes")

    def settings(self) -> dict[str, Any]:
        """As of every task; how processes talk changes no result."""
        ours = ("processes", "transport", "deadline", "metrics")
        others = {name: value for name, value in super().settings().items() if name not in ours}
        if self.processes is None:
            return others
        return {**others, "processes": self.processes or True}


@dataclass(frozen=True)
class CertifyOptions:
    """What to check of a file of results.

    Attributes:
        lines: Numbers of the lines to check, from 1 (default: all).
        conditions: File of the requested conditions; each line's condition must equal the one with the same number.
        quiet: Print only the totals.
    """

    lines: tuple[int, ...] = ()
    conditions: Path | None = None
    quiet: bool = False


@dataclass(frozen=True)
class EvaluateOptions(FieldOptions):
    """What to measure.

    Attributes:
        sizes: Numbers of agents.
        seed: Seed of cases and of z(0).
        max_draws: Limit of draws of a case that does not satisfy its requirements.
        out: JSON Lines file that receives the rows; rerun the command to resume.
        weights: Another weights file (.safetensors, card beside it).
    """

    sizes: tuple[int, ...] = (4, 5, 6, 7, 8)
    seed: int = 1
    max_draws: int = 8
    out: Path | None = None
    weights: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("seed", self.seed, 0, MAX_SEED)
        check_range("max-draws", self.max_draws, 1, MAX_DRAWS)

    def check_sizes(self, least: int, most: int) -> None:
        """Raises `InputError` if a size lies outside the task's range."""
        for size in self.sizes:
            check_range("sizes", size, least, most)

    def settings(self, task: str, weights: str | None) -> dict[str, Any]:
        """What tells runs apart, whatever is measured: JSON values by name. `weights` tells the field from others."""
        return {
            "command": f"{task} evaluate",
            "seed": self.seed,
            "max_draws": self.max_draws,
            "evaluations": self.evaluations,
            "guidance_phase": self.guidance_phase,
            "weights": weights,
        }


@dataclass(frozen=True)
class RenderOptions(FieldOptions):
    """What to draw of each result; `evaluations` and `guidance_phase` are those it was generated with.

    Attributes:
        out: Folder that receives the pictures.
        lines: Numbers of the lines to draw, from 1 (default: the first 12).
        weights: Weights that the results were generated with, in case they have to be generated again.
    """

    out: Path = Path("pictures")
    lines: tuple[int, ...] = ()
    weights: Path | None = None


class TaskOptions(NamedTuple):
    """The dataclasses of a task's options, one for each command."""

    data: type[Recipe] = Recipe
    train: type[TrainOptions] = TrainOptions
    generate: type[GenerateOptions] = GenerateOptions
    certify: type[CertifyOptions] = CertifyOptions
    evaluate: type[EvaluateOptions] = EvaluateOptions
    render: type[RenderOptions] = RenderOptions
