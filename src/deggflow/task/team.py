"""A ready-made kind of task: the result is a team's states at tau = 1. A subclass declares only its particulars."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import jax
import numpy as np
from jaxtyping import Bool, Float

from deggflow import consistency
from deggflow.certificate import RequirementVerdict
from deggflow.certification import verdicts
from deggflow.consistency import Line, Unverified, Wrong
from deggflow.field import TeamFeatures
from deggflow.files import StrPath
from deggflow.flow import Field
from deggflow.guidance import AbstractRequirement, DecoupledGuidance
from deggflow.jsonl import InputError
from deggflow.sampling import sample
from deggflow.schema import parse_as
from deggflow.shapes import States
from deggflow.tables import read_results

from .formats import Formats
from .interface import (
    AbstractGenerator,
    AbstractTask,
    Chunking,
    Examination,
    OnStatus,
    RunSettings,
)
from .options import EvaluateOptions, GenerateOptions, MessagePassingOptions, TaskOptions
from .team_model import TeamModel
from .team_report import TeamOptions, TeamSuccess
from .team_sample import TeamCondition, TeamSample, parse_sample, sample_lines

ROUNDING = 1e-6  # relative to 1 + |margin|: a certificate's numbers may differ so much from those recomputed


UNVERIFIED: Unverified = {
    "condition": "except with --conditions",
    "agents": "if other states satisfy all statements",
    "seed": "",
    "certificate.draws": "",
    "certificate.violation": "",
    **consistency.unverified_record("certificate.generation"),
}


@dataclass(frozen=True)
class TeamTrain(MessagePassingOptions):
    """How to train the field.

    Attributes:
        steps: Training steps, a multiple of 500.
    """

    steps: int = 10_000
    width: int = 64
    head_width: int = 128


class AbstractTeamTask(AbstractTask[TeamCondition, TeamSample]):
    """A task of which a user declares only the particulars.

    Attributes:
        name: The task's name on the command line.
        noun: The word for one sample.
        sizes: Least and largest number of agents.
        dim: Dimension of each agent's state.
        scale: Units of the states in files per unit of z; the data should have a spread of about one in z.
        condition: Dataclass of the conditions, derived from `TeamCondition`.
        weights: Weights that `generate` uses by default; None if there are none yet.
        tolerance: How far the oracle's margins may be negative because of rounding, in the requirements' units.
    """

    dim: int
    scale: float = 1.0
    condition: type[TeamCondition]
    weights: Path | None = None
    tolerance: float = 1e-9
    options = TaskOptions(train=TeamTrain, evaluate=TeamOptions)

    @abstractmethod
    def random_condition(self, size: int, rng: np.random.Generator) -> TeamCondition:
        """A random condition for `size` agents."""

    @abstractmethod
    def size_of(self, condition: TeamCondition) -> int:
        """Number of agents of a condition; raises `InputError` naming the field if the condition contradicts itself."""

    @abstractmethod
    def arrays(self, condition: TeamCondition, agents: int) -> Any:
        """A condition as a pytree of numpy arrays, padded to `agents`; its attribute `mask` marks present agents."""

    @abstractmethod
    def demonstrate(
        self, condition: TeamCondition, rng: np.random.Generator
    ) -> Float[np.ndarray, "agents dim"]:
        """Random desired states; the field learns their distribution."""

    @abstractmethod
    def features(self, z: States, condition: Any) -> TeamFeatures:
        """The field's features of z and of the arrays of a condition."""

    @property
    @abstractmethod
    def requirements(self) -> tuple[AbstractRequirement, ...]:
        """The requirements, which guidance enforces and certificates report."""

    @abstractmethod
    def least_margin(
        self, condition: TeamCondition, states: Float[np.ndarray, "agents dim"]
    ) -> float:
        """The oracle: the least margin of all requirements, by code that is independent of them."""

    @abstractmethod
    def draw(self, axes: Any, sample: TeamSample) -> None:
        """Draws a sample on matplotlib axes."""

    # The rest is the same for all team tasks.

    @property
    def formats(self) -> Formats[TeamCondition, TeamSample]:
        """Samples with their certificates, and demonstrations."""
        kind: Any = self.condition
        return Formats(
            self._condition, self._sample, self.condition.to_json, sample_lines(kind), UNVERIFIED
        )

    @property
    def model(self) -> TeamModel:
        """Demonstrations by the task's expert, and a message-passing field."""
        return TeamModel(self)

    def _condition(self, value: Any, field: str) -> TeamCondition:
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
        """Random conditions; each depends only on the seed, the size and its own number."""
        return [
            self.random_condition(size, np.random.default_rng([options.seed, size, number]))
            for number in range(first, first + count)
        ]

    def stack(
        self, conditions: Sequence[TeamCondition]
    ) -> tuple[Any, Bool[np.ndarray, "samples agents"]]:
        """Arrays of conditions with a leading axis, padded to the largest team, and the mask of present agents."""
        arrays = [self.arrays(condition, self.sizes[1]) for condition in conditions]
        batch = jax.tree.map(lambda *leaves: np.stack(leaves), *arrays)
        return batch, np.asarray(batch.mask)

    def _sample(self, value: Any) -> TeamSample:
        return self._parse(value, certified=True)

    def read_demonstrations(self, path: StrPath) -> list[TeamSample]:
        """All demonstrations of a file; raises `InputError` for the first invalid one."""
        what = f"{self.name} demonstration"
        return read_results(
            path, lambda line: self._parse(line, certified=False), what, self.formats.lines
        )

    def _parse(self, value: Any, *, certified: bool) -> TeamSample:
        result = parse_sample(value, self.condition, self.dim, certified=certified)
        self.parse_condition(value["condition"], "condition")
        agents, states = self.size_of(result.condition), len(result.states)
        if states != agents:
            raise InputError(
                f"must hold the condition's {agents} agents; got {states}", field="agents"
            )
        return result

    def generator(self, field: Field, options: GenerateOptions) -> "TeamGenerator":
        """A generator that calls `deggflow.sample`."""
        return TeamGenerator(self, field, guided=options.guided)

    def examine(self, result: TeamSample, line: Line) -> Examination:
        """Checks a sample by the requirements in float64 and by the oracle."""
        assert result.certificate is not None
        size, arrays = self.sizes[1], self.arrays(result.condition, self.sizes[1])
        z = np.zeros((size, self.dim))
        z[: len(result.states)] = result.states / self.scale
        checks = verdicts(z, self.requirements, arrays, mask=arrays.mask)
        margin = min(each.margin for each in checks)
        oracle = self.least_margin(result.condition, result.states)
        satisfied = margin >= 0 and oracle >= -self.tolerance
        reason = next((each.reason for each in checks if each.reason), "by the oracle")
        text = "it holds" if satisfied else f"it does NOT hold: {reason}"
        return Examination(
            satisfied,
            f"{text} (least margin {margin:.3g}, by the oracle {oracle:.3g})",
            list(self._contradictions(line["certificate"], satisfied, checks)),
            result.certificate.table(),
        )

    def _contradictions(
        self, certificate: Line, satisfied: bool, checks: Sequence[RequirementVerdict]
    ) -> Iterator[Wrong]:
        field, claim = "certificate", certificate["satisfied"]
        if claim != satisfied:
            what = "all requirements hold" if satisfied else "a requirement is violated"
            yield Wrong(f"{field}.satisfied", f"is {str(claim).lower()}, but {what}")
        yield from consistency.check_claim(certificate, field)
        least = min(each.margin for each in checks)
        if not abs(certificate["min_margin"] - least) <= ROUNDING * (1 + abs(least)):
            yield Wrong(f"{field}.min_margin", f"is not the least margin, {least:.9g}")
        margins = {each["name"]: each["margin"] for each in certificate.get("verdicts", [])}
        if list(margins) != [each.name for each in checks]:
            yield Wrong(f"{field}.verdicts", "are not of the task's requirements")
        for k, each in enumerate(checks):
            margin = margins.get(each.name, each.margin)
            if not abs(margin - each.margin) <= ROUNDING * (1 + abs(each.margin)):
                where = f"{field}.verdicts[{k}].margin"
                yield Wrong(where, f"is not the margin of {each.name}, {each.margin:.9g}")
        record = certificate.get("generation")
        if record is not None:
            names = DecoupledGuidance(self.requirements).names
            agents = [f"agent {k}" for k in range(self.sizes[1])]
            yield from consistency.check_generation(record, f"{field}.generation", names, agents)

    def evaluation(
        self, field: Field, options: EvaluateOptions, weights: str | None
    ) -> TeamSuccess:
        """Success of nominal and guided samples."""
        options.check_sizes(*self.sizes)
        return TeamSuccess(self, field, cast(TeamOptions, options), weights)


class TeamGenerator(AbstractGenerator[TeamCondition, TeamSample]):
    """Certified samples of a team task."""

    def __init__(self, task: AbstractTeamTask, field: Field, *, guided: bool) -> None:
        """Args: task: the task; field: nominal field; guided: whether guidance acts."""
        self._task, self._field, self._guided = task, field, guided
        self._guidance = DecoupledGuidance(task.requirements)

    def chunking(self, condition: TeamCondition) -> Chunking:
        """Chunks of the default size; the next one is generated while one is written."""
        return Chunking(concurrent=True)

    def generate(
        self, conditions: Sequence[TeamCondition], run: RunSettings, on_status: OnStatus
    ) -> Iterator[list[TeamSample]]:
        """Generates all samples in one batch; z(0) follows from the seed and the number of the first condition."""
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
