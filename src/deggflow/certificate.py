"""What is said of a finished sample, as a value: the verdict and the record of its generation, in a table and in JSON.

A certificate has two independent parts. The verdict is made in float64 on the finished sample, by every requirement of
the guidance, and trusts nothing that happened on the way. The record says what did: every requirement's value against
its limit, and whether the conditions of the theorems held at every accepted point.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class RequirementVerdict:
    """One requirement at the end, in float64."""

    name: str
    margin: float  # least margin, in the requirement's unit; negative where it is broken
    reason: str | None  # who misses it by how much, if it is broken


@dataclass(frozen=True)
class RequirementRecord:
    """One requirement along a generation, V or q by its name."""

    name: str
    value: float  # at the last point
    limit: float  # what it may be there
    excess: float  # greatest value - limit of all points; positive where it was above
    active: int  # points at which it decided some agent's input
    smallest_ell: float | None  # least |ell| of an agent that had to act; None if none had to
    forced: int = 0  # forced steps that left it above its limit
    forced_agents: tuple[str, ...] = ()  # whose violation it was then
    kinks: int = 0  # points at which it had no gradient


@dataclass(frozen=True)
class TraceRecord:
    """Every requirement's value at every point, against what the theorem promises."""

    tau: tuple[float, ...]
    value: tuple[tuple[float, ...], ...]  # points x requirements
    bound: tuple[tuple[float, ...], ...]  # promised in continuous time
    limit: tuple[tuple[float, ...], ...]  # what a discrete step may reach


@dataclass(frozen=True)
class GenerationRecord:
    """What happened in a generation, and whether the conditions of the theorems held all along."""

    held: bool  # rows feasible, conditions met, no value above its limit
    broken: str | None  # the first of these that failed: where, and at which agent
    requirements: tuple[RequirementRecord, ...]
    steps: int  # steps taken
    refused: int  # steps that landed above a limit and were halved
    forced: int  # steps taken although they landed above a limit
    least_sine: float | None  # between two opposed rows of one agent; None if none were opposed
    effort: float  # largest |u_i|
    largest_step: float | None = None  # greatest distance in z between two points, of one agent
    trace: TraceRecord | None = None

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without what is not known, and without counts that are zero."""
        out = asdict(self)
        for name in ("trace", "largest_step"):
            if out[name] is None:
                del out[name]
        for each in out["requirements"]:
            for name in ("forced", "forced_agents", "kinks"):
                if not each[name]:
                    del each[name]
        return out


@dataclass(frozen=True)
class Certificate:
    """The verdict on one sample, made in float64 on the decoded object, and the record of its generation."""

    satisfied: bool
    min_margin: (
        float  # least margin of all requirements, in their units; negative where one is broken
    )
    violation: float  # V at the end; of shared requirements what q exceeds its end value by
    draws: int  # initial samples tried, this one included
    reason: str | None  # which agent and which requirement, if not satisfied
    generation: GenerationRecord | None = None
    verdicts: tuple[RequirementVerdict, ...] = ()  # of each requirement

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without `generation` and `verdicts` where none are kept."""
        out = asdict(self)
        if self.generation is None:
            del out["generation"]
        else:
            out["generation"] = self.generation.to_json()
        if not self.verdicts:
            del out["verdicts"]
        return out

    def table(self) -> str:
        """The certificate as a readable table."""
        draws = f"{self.draws} draw" + "s" * (self.draws != 1)
        head = "satisfied" if self.satisfied else f"NOT satisfied: {self.reason}"
        lines = [f"{head}; least margin {self.min_margin:.3g}, V {self.violation:.3g}, {draws}"]
        margins = {each.name: f"{each.margin:.3g}" for each in self.verdicts}
        return "\n".join(lines + _record_lines(self.generation, margins))


def _record_lines(made: GenerationRecord | None, margins: dict[str, str]) -> list[str]:
    if made is None:
        if not margins:
            return []
        table = columns([("requirement", "margin"), *margins.items()])
        return ["no record: no requirement guided this generation", *table]
    sine = "no rows opposed" if made.least_sine is None else f"least sine {made.least_sine:.2g}"
    points = count_points(made.steps + 1)
    apart = "" if made.largest_step is None else f", at most {made.largest_step:.3g} apart"
    held = f"held at all {points}{apart}" if made.held else f"did not hold: {made.broken}"
    head: tuple[str, ...] = (
        "requirement", "at the end", "limit", "most above", "active at", "least |ell|",
    )  # fmt: skip
    rows: list[tuple[str, ...]] = [
        (
            each.name,
            f"{each.value:.3g}",
            f"{each.limit:.3g}",
            f"{each.excess:.3g}",
            count_points(each.active),
            "-" if each.smallest_ell is None else f"{each.smallest_ell:.3g}",
        )
        for each in made.requirements
    ]
    if margins:  # tasks that judge the decoded object have theirs elsewhere
        head = (head[0], "margin", *head[1:])
        rows = [(row[0], margins.get(row[0], "-"), *row[1:]) for row in rows]
    taken = f"{made.steps} steps, {made.refused} refused, {made.forced} forced"
    lines = [f"conditions {held}", f"{taken}; {sine}; largest |u| {made.effort:.3g}"]
    return lines + columns([head, *rows])


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
