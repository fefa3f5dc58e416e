"""What is said of a finished sample, as a value: the verdict and the record of its generation, in a table and in JSON.

A certificate has two independent parts. The verdict is made in float64 on the finished sample, by every requirement of
the guidance, and trusts nothing that happened on the way. The record says what did: every requirement's value against
its limit, and whether the hypotheses of the theorems hold at every accepted point.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .notebook import certificate_html


@dataclass(frozen=True)
class RequirementVerdict:
    """One requirement at the end, in float64.

    Attributes:
        name: Of the requirement.
        margin: Least margin, in the requirement's unit; negative where the requirement is violated.
        reason: Who misses it by how much, if it is violated.
    """

    name: str
    margin: float
    reason: str | None


@dataclass(frozen=True)
class RequirementRecord:
    """One requirement along a generation, V or q by its name.

    Attributes:
        name: Of the requirement.
        value: V or q at the last point.
        limit: Its limit there.
        excess: Greatest value - limit of all points; positive if the value was above its limit.
        active_points: Points at which the requirement decided some agent's input.
        smallest_ell_norm: Smallest |ell| of an agent that had to act; None if none had to.
        forced_steps: Forced steps that left the value above its limit.
        forced_agents: Agents to which these steps are ascribed.
        kink_points: Points at which the requirement had no gradient.
    """

    name: str
    value: float
    limit: float
    excess: float
    active_points: int
    smallest_ell_norm: float | None
    forced_steps: int = 0
    forced_agents: tuple[str, ...] = ()
    kink_points: int = 0


@dataclass(frozen=True)
class TraceRecord:
    """Every requirement's value at every point, against what the theorem promises.

    Attributes:
        tau: Increasing from 0 to 1.
        value: V or q, points x requirements.
        bound: What the theorem promises in continuous time, points x requirements.
        limit: The most that a discrete step may reach, points x requirements.
    """

    tau: tuple[float, ...]
    value: tuple[tuple[float, ...], ...]
    bound: tuple[tuple[float, ...], ...]
    limit: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LostAgent:
    """An agent that fell silent in a generation by processes, and stayed where it was.

    Attributes:
        agent: Its name.
        tau: Where it stopped.
    """

    agent: str
    tau: float


@dataclass(frozen=True)
class GenerationRecord:
    """What happened in a generation, and whether the hypotheses of the theorems hold along it.

    Attributes:
        hypotheses_hold: Whether rows were feasible, the theorems' hypotheses hold and no value was above its limit,
            at every accepted point.
        first_failure: The first of these that failed: where, and at which agent.
        requirements: One record for each.
        steps: Steps taken.
        refused_steps: Steps that ended above a limit and were halved.
        forced_steps: Steps that were taken although they ended above a limit.
        least_opposed_sine: Least sine between two opposed rows of one agent; None if no rows were opposed.
        largest_input_norm: Largest |u_i|.
        largest_step: Greatest distance in z that an agent moved from one point to the next.
        trace: Values at the points of the grid, if it was kept.
        lost: Agents that were lost, in a generation by processes; the others took over their shares.
    """

    hypotheses_hold: bool
    first_failure: str | None
    requirements: tuple[RequirementRecord, ...]
    steps: int
    refused_steps: int
    forced_steps: int
    least_opposed_sine: float | None
    largest_input_norm: float
    largest_step: float
    trace: TraceRecord | None = None
    lost: tuple[LostAgent, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without a trace that was not kept, without counts that are zero and lost agents if none were."""
        out = _fields(self)
        out["requirements"] = tuple(_requirement_json(each) for each in self.requirements)
        out["trace"] = None if self.trace is None else _fields(self.trace)
        out["lost"] = tuple(_fields(each) for each in self.lost)
        for name in ("trace", "lost"):
            if not out[name]:
                del out[name]
        return out


def _fields(value: Any) -> dict[str, Any]:
    """A dataclass's fields by name. `asdict` would copy all that they hold, which takes as long as a verdict."""
    return dict(vars(value))


def _requirement_json(requirement: RequirementRecord) -> dict[str, Any]:
    out = _fields(requirement)
    for name in ("forced_steps", "forced_agents", "kink_points"):
        if not out[name]:
            del out[name]
    return out


def with_generation(out: dict[str, Any], generation: GenerationRecord | None) -> dict[str, Any]:
    """The JSON object with the record as it stands in a file, or without "generation" where there is none."""
    if generation is None:
        del out["generation"]
    else:
        out["generation"] = generation.to_json()
    return out


@dataclass(frozen=True)
class Certificate:
    """The verdict on one sample, made in float64 on the decoded object, and the record of its generation.

    Attributes:
        satisfied: Whether every requirement holds.
        min_margin: Least margin of all requirements, in their units; negative where one is violated.
        violation: V at the end; of shared requirements, by how much q exceeds its end value.
        draws: Initial samples tried, this one included.
        reason: Which agent misses which requirement, if not satisfied.
        generation: Record of the generation; None if no requirement guided it.
        verdicts: One for each requirement.
    """

    satisfied: bool
    min_margin: float
    violation: float
    draws: int
    reason: str | None
    generation: GenerationRecord | None = None
    verdicts: tuple[RequirementVerdict, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without `generation` and `verdicts` where none are kept."""
        out = with_generation(_fields(self), self.generation)
        out["verdicts"] = tuple(_fields(each) for each in self.verdicts)
        if not self.verdicts:
            del out["verdicts"]
        return out

    def _repr_html_(self) -> str:
        """What notebooks show."""
        return certificate_html(self)

    def table(self) -> str:
        """The certificate as a readable table."""
        draws = f"{self.draws} draw" + "s" * (self.draws != 1)
        head = "satisfied" if self.satisfied else f"NOT satisfied: {self.reason}"
        lines = [f"{head}; least margin {self.min_margin:.3g}, V {self.violation:.3g}, {draws}"]
        margins = {each.name: f"{each.margin:.3g}" for each in self.verdicts}
        return "\n".join(lines + _record_lines(self.generation, margins))


def _record_lines(record: GenerationRecord | None, margins: dict[str, str]) -> list[str]:
    if record is None:
        if not margins:
            return []
        table = columns([("requirement", "margin"), *margins.items()])
        return ["no record: no requirement guided this generation", *table]
    points = count_points(record.steps + 1)
    if record.hypotheses_hold:
        hypotheses = f"hold at all {points}, at most {record.largest_step:.3g} apart"
    else:
        hypotheses = f"do not hold: {record.first_failure}"
    sine = "no opposed rows"
    if record.least_opposed_sine is not None:
        sine = f"least opposed sine {record.least_opposed_sine:.2g}"
    head: tuple[str, ...] = (
        "requirement", "value at the end", "limit", "largest excess", "active at", "smallest |ell|",
    )  # fmt: skip
    rows: list[tuple[str, ...]] = [
        (
            each.name,
            f"{each.value:.3g}",
            f"{each.limit:.3g}",
            f"{each.excess:.3g}",
            count_points(each.active_points),
            "-" if each.smallest_ell_norm is None else f"{each.smallest_ell_norm:.3g}",
        )
        for each in record.requirements
    ]
    if margins:  # tasks that judge the decoded object have theirs elsewhere
        head = (head[0], "margin", *head[1:])
        rows = [(row[0], margins.get(row[0], "-"), *row[1:]) for row in rows]
    steps = f"{record.steps} steps, {record.refused_steps} refused, {record.forced_steps} forced"
    lost = [f"lost: {each.agent} at tau = {each.tau:.3g}" for each in record.lost]
    return [
        f"hypotheses {hypotheses}",
        *lost,
        f"{steps}; {sine}; largest |u| {record.largest_input_norm:.3g}",
        *columns([head, *rows]),
    ]


def count_points(count: Any) -> str:
    """A number of points in words."""
    return f"{int(count)} point" + "s" * (int(count) != 1)


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of text as lines with aligned columns, the first to the left, the others to the right."""
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if k else text.ljust(width)
            for k, (text, width) in enumerate(zip(row, wide, strict=True))
        )
        for row in rows
    ]
