"""A ready-made kind of task: a team whose states at tau = 1 are the result. What is particular is declared, no more."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import jax
import numpy as np
from jaxtyping import Bool, Float

from deggflow import consistency
from deggflow.certification import verdicts
from deggflow.consistency import Line, Unverified, Wrong
from deggflow.field import TeamFeatures
from deggflow.files import StrPath
from deggflow.flow import Field
from deggflow.guidance import AbstractRequirement, DecoupledGuidance
from deggflow.jsonl import InputError, read_lines
from deggflow.sampling import sample
from deggflow.schema import parse_as
from deggflow.shapes import States

from .interface import (
    AbstractGenerator,
    AbstractTask,
    Chunking,
    Claim,
    Examination,
    OnStatus,
    RunSettings,
)
from .options import EvaluateOptions, GenerateOptions, TaskOptions, TrainOptions, check_range
from .team_model import TeamModel
from .team_report import TeamOptions, TeamSuccess
from .team_sample import TeamCondition, TeamSample, parse_sample

ROUNDING = 1e-6  # of 1 + |margin|, by which a certificate's numbers may differ from those of the file's states


UNVERIFIED: Unverified = {
    "condition": "but by --conditions",
    "agents": "where others leave all that is said true",
    "seed": "",
    "certificate.draws": "",
    "certificate.violation": "",
    **{f"certificate.generation.{name}": remark for name, remark in consistency.RECORD.items()},
}


@dataclass(frozen=True)
class TeamTrain(TrainOptions):
    """How the field is trained.

    Attributes:
        width: Width of the message-passing layers.
        rounds: Rounds of messages.
        head_width: Width of the last layers.
    """

    steps: int = 10_000
    width: int = 64
    rounds: int = 2
    head_width: int = 128


class AbstractTeamTask(AbstractTask[TeamCondition, TeamSample]):
    """A task of which a user states only what is particular to it.

    Attributes:
        name: On the command line.
        noun: What a sample is called.
        sizes: Least and largest number of agents.
        dim: Numbers of each agent's state.
        scale: The task's unit, of states in files, for one unit of z; data should have a spread of about one in z.
        condition: Dataclass of the conditions, derived from `TeamCondition`.
        weights: Weights that `generate` uses by default; None if there are none yet.
        tolerance: By which the oracle's margins may be negative through rounding, in the requirements' units.
    """

    dim: int
    scale: float = 1.0
    condition: type[TeamCondition]
    weights: Path | None = None
    tolerance: float = 1e-9
    options = TaskOptions(train=TeamTrain, evaluate=TeamOptions)
    unverified = UNVERIFIED

    @abstractmethod
    def random_condition(self, size: int, rng: np.random.Generator) -> TeamCondition:
        """A condition for so many agents."""

    @abstractmethod
    def size_of(self, condition: TeamCondition) -> int:
        """How many agents a condition has; `InputError` with the field where it contradicts itself."""

    @abstractmethod
    def arrays(self, condition: TeamCondition, agents: int) -> Any:
        """A condition as a pytree of numpy arrays, padded to `agents`; its attribute `mask` says who is present."""

    @abstractmethod
    def demonstrate(
        self, condition: TeamCondition, rng: np.random.Generator
    ) -> Float[np.ndarray, "agents dim"]:
        """States as they should be, drawn at random; the field learns their distribution."""

    @abstractmethod
    def features(self, z: States, condition: Any) -> TeamFeatures:
        """What the field reads of z and the arrays of a condition."""

    @property
    @abstractmethod
    def requirements(self) -> tuple[AbstractRequirement, ...]:
        """What guidance enforces and certificates state."""

    @abstractmethod
    def least_margin(
        self, condition: TeamCondition, states: Float[np.ndarray, "agents dim"]
    ) -> float:
        """The oracle: the least margin of all requirements, by code that shares nothing with them."""

    @abstractmethod
    def draw(self, axes: Any, sample: TeamSample) -> None:
        """Draws a sample on axes of matplotlib."""

    # What follows is the same for all team tasks.

    @property
    def claim(self) -> Claim:
        """Of samples by the task's own noun."""
        return Claim(
            f"{self.noun} satisfies every requirement", f"{self.noun}s satisfy every requirement"
        )

    @property
    def model(self) -> TeamModel:
        """The task's expert, and a message-passing field."""
        return TeamModel(self)

    def parse_condition(self, value: Any, field: str = "") -> TeamCondition:
        """A condition by its dataclass."""
        condition = parse_as(self.condition, value, field)
        size = self.size_of(condition)
        if not self.sizes[0] <= size <= self.sizes[1]:
            raise InputError(
                f"must have {self.sizes[0]} to {self.sizes[1]} agents; got {size}",
                field=field,
            )
        return condition

    def random_conditions(
        self, size: int, count: int, first: int, options: GenerateOptions
    ) -> list[TeamCondition]:
        """Each from its own number."""
        return [
            self.random_condition(size, np.random.default_rng([options.seed, size, number]))
            for number in range(first, first + count)
        ]

    def stack(
        self, conditions: Sequence[TeamCondition]
    ) -> tuple[Any, Bool[np.ndarray, "samples agents"]]:
        """Arrays of conditions with a leading axis, padded to the largest team, and who is present."""
        arrays = [self.arrays(condition, self.sizes[1]) for condition in conditions]
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *arrays)
        return stacked, np.asarray(stacked.mask)

    def other_condition(self, asked: TeamCondition, given: TeamCondition) -> Wrong | None:
        """The first difference."""
        return consistency.first_difference(asked.to_json(), given.to_json(), "condition")

    def parse_result(self, value: Any) -> TeamSample:
        """A sample with its certificate."""
        return self._parse(value, certified=True)

    def read_demonstrations(self, path: StrPath) -> list[TeamSample]:
        """All demonstrations of a file, or `InputError` for the first that is wrong."""
        return read_lines(
            path, lambda line: self._parse(line, certified=False), f"{self.name} demonstration"
        )

    def _parse(self, value: Any, *, certified: bool) -> TeamSample:
        found = parse_sample(value, self.condition, self.dim, certified=certified)
        self.parse_condition(value["condition"], "condition")
        if len(found.states) != self.size_of(found.condition):
            raise InputError(
                f"must hold the condition's {self.size_of(found.condition)} agents; got {len(found.states)}",
                field="agents",
            )
        return found

    def generator(self, field: Field, options: GenerateOptions) -> "TeamGenerator":
        """By `deggflow.sample`."""
        return TeamGenerator(self, field, guided=options.guided)

    def fails(self, row: Line, *, guided: bool) -> bool:
        """Whether the certificate says that a requirement is missed."""
        return not row["certificate"]["satisfied"]

    def examine(self, result: TeamSample, line: Line) -> Examination:
        """By the requirements in float64, and by the oracle."""
        assert result.certificate is not None
        size, arrays = self.sizes[1], self.arrays(result.condition, self.sizes[1])
        z = np.zeros((size, self.dim))
        z[: len(result.states)] = result.states / self.scale
        said = verdicts(z, self.requirements, arrays, mask=arrays.mask)
        margin = min(each.margin for each in said)
        oracle = self.least_margin(result.condition, result.states)
        good = margin >= 0 and oracle >= -self.tolerance
        missed = next((each.reason for each in said if each.reason), "by the oracle")
        text = "it holds" if good else f"it does NOT hold: {missed}"
        return Examination(
            good,
            f"{text} (least margin {margin:.3g}, by the oracle {oracle:.3g})",
            list(self._contradictions(line["certificate"], good, said)),
            result.certificate.table(),
        )

    def _contradictions(self, said: Line, good: bool, found: Sequence[Any]) -> Iterator[Wrong]:
        field = "certificate"
        if said["satisfied"] != good:
            what = "all requirements hold" if good else "a requirement is missed"
            yield Wrong(f"{field}.satisfied", f"is {str(said['satisfied']).lower()}, but {what}")
        yield from consistency.check_claim(said, field)
        least = min(each.margin for each in found)
        if not abs(said["min_margin"] - least) <= ROUNDING * (1 + abs(least)):
            yield Wrong(f"{field}.min_margin", f"is not the least margin, {least:.9g}")
        named = {each["name"]: each["margin"] for each in said.get("verdicts", [])}
        if list(named) != [each.name for each in found]:
            yield Wrong(f"{field}.verdicts", "are not of the task's requirements")
        for k, each in enumerate(found):
            margin = named.get(each.name, each.margin)
            if not abs(margin - each.margin) <= ROUNDING * (1 + abs(each.margin)):
                where = f"{field}.verdicts[{k}].margin"
                yield Wrong(where, f"is not the margin of {each.name}, {each.margin:.9g}")
        if said.get("generation") is not None:
            names = DecoupledGuidance(self.requirements).names
            agents = [f"agent {k}" for k in range(self.sizes[1])]
            yield from consistency.check_generation(
                said["generation"], f"{field}.generation", names, agents
            )

    def conclude(self, examinations: Sequence[Examination]) -> str:
        """How many hold, and of how many lines something is wrong."""
        return self.claim.in_total(examinations)

    def evaluation(
        self, field: Field, options: EvaluateOptions, weights: str | None
    ) -> TeamSuccess:
        """Nominal beside guided."""
        for size in options.sizes:
            check_range("sizes", size, *self.sizes)
        return TeamSuccess(self, field, cast(TeamOptions, options), weights)


class TeamGenerator(AbstractGenerator[TeamCondition, TeamSample]):
    """Certified samples of a team task."""

    def __init__(self, task: AbstractTeamTask, field: Field, *, guided: bool) -> None:
        """Args: task: whose samples; field: nominal field; guided: whether guidance acts."""
        self._task, self._field, self._guided = task, field, guided
        self._guidance = DecoupledGuidance(task.requirements)

    def chunking(self, condition: TeamCondition) -> Chunking:
        """The next chunk is generated while one is written."""
        return Chunking(concurrent=True)

    def generate(
        self, conditions: Sequence[TeamCondition], run: RunSettings, on_status: OnStatus
    ) -> Iterator[list[TeamSample]]:
        """All at once; z(0) from the seed, the number of the first condition and that of the sample."""
        task, count = self._task, len(conditions)
        arrays, masks = task.stack(conditions)
        samples = sample(
            self._field, self._guidance,
            key=jax.random.fold_in(jax.random.key(run.seed), run.first), count=count,
            shape=(task.sizes[1], task.dim), conditions=arrays, masks=masks,
            max_draws=run.max_draws, guided=self._guided,
        )  # fmt: skip
        yield [
            TeamSample(
                condition,
                z[: int(mask.sum())].astype(np.float64) * task.scale,
                run.seed,
                certificate,
            )
            for condition, z, mask, certificate in zip(
                conditions, samples.z, masks, samples.certificates, strict=True
            )
        ]
