"""Certificates in words: what a summary says of a generation, and what margins say of its end."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from .certificate import (
    GenerationRecord,
    RequirementRecord,
    RequirementVerdict,
    TraceRecord,
    count_points,
)
from .guidance import DecoupledGuidance
from .trace import NotANumber, Summary, Trace


def record(
    summary: Summary,
    names: Sequence[str],
    agents: Sequence[str] | None = None,
    trace: Trace | None = None,
) -> GenerationRecord:
    """The record of one generation.

    Args:
        summary: Of one sample.
        names: Of the requirements, one per row.
        agents: What to call the agents; "agent 0", ... if None.
        trace: Also kept, if given.
    """
    made = jax.tree.map(np.asarray, summary)
    called = agent_names(agents, made.stuck.shape[-1])
    held, sine, work = bool(made.held), float(made.sine), made.work
    return GenerationRecord(
        held=held,
        broken=None if held else _first_failure(made, names, called),
        requirements=tuple(
            RequirementRecord(
                name,
                finite(made.value[k]),
                finite(made.limit[k]),
                finite(made.excess[k]),
                int(made.active[k]),
                finite(made.length[k]) if np.isfinite(made.length[k]) else None,
                int(made.forced[k].max(initial=0)),
                tuple(called[i] for i in np.flatnonzero(made.forced[k])),
                int(made.kinks[k]),
            )
            for k, name in enumerate(names)
        ),
        steps=int(made.points) - 1,
        refused=int(work.refused),
        forced=int(work.forced),
        least_sine=sine if sine < 1 else None,
        effort=finite(made.effort.max(initial=0.0)),
        largest_step=finite(made.largest_step),
        trace=None if trace is None else _trace_record(trace),
    )


def agent_names(agents: Sequence[str] | None, count: int) -> list[str]:
    """What agents are called; those without a name, by their number."""
    given = list(agents or ())
    return given + [f"agent {k}" for k in range(len(given), count)]


def finite(value: Any) -> float:
    """A number that files can hold: what has diverged stands at the end of the scale."""
    number = float(value)
    return 1e12 if math.isnan(number) else min(max(number, -1e12), 1e12)


def _trace_record(trace: Trace) -> TraceRecord:
    def rows(values: Float[Array | np.ndarray, "points rows"]) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(finite(x) for x in row) for row in np.asarray(values, np.float64))

    tau = tuple(np.asarray(trace.tau, np.float64).tolist())
    return TraceRecord(tau, rows(trace.value), rows(trace.bound), rows(trace.limit))


def _first_failure(made: Any, names: Sequence[str], agents: Sequence[str]) -> str:
    """The condition that failed first, in the order in which one leads to the next."""
    if made.not_a_number:
        return not_a_number(made.nan, names, agents)
    if made.infeasible.any():
        worst = int(made.infeasible.argmax())
        return f"no input of {agents[worst]} met all its rows at {count_points(made.infeasible[worst])}"
    if made.stuck.any():
        row, agent = divmod(int(made.stuck.argmax()), made.stuck.shape[1])
        count = count_points(made.stuck[row, agent])
        return f"{agents[agent]} did not meet its row of {names[row]} at {count}"
    row, forced = int(made.excess.argmax()), int(made.work.forced)
    texts = []
    if made.excess[row] > 0:
        texts.append(f"{names[row]} was above its limit by {finite(made.excess[row]):.3g}")
    if forced:
        texts.append(f"{forced} steps were forced{_whose(made.forced, names, agents)}")
    if made.kinks.any():
        row = int(made.kinks.argmax())
        texts.append(f"{names[row]} has no gradient (a kink) at {count_points(made.kinks[row])}")
    if not made.ordered:
        texts.append("tau did not increase from each point to the next")
    return ", ".join(texts)


def _whose(forced: np.ndarray, names: Sequence[str], agents: Sequence[str], most: int = 4) -> str:
    """The requirements and agents at which forced steps were stuck."""
    parts = []
    for row in np.flatnonzero(forced.any(axis=1)):
        order = np.argsort(-forced[row], kind="stable")
        stuck = [agents[int(k)] for k in order if forced[row, k]]
        more = f" and {len(stuck) - most} more" if len(stuck) > most else ""
        parts.append(f"{names[int(row)]} at {', '.join(stuck[:most])}{more}")
    return f": {'; '.join(parts)}" if parts else ""


def not_a_number(nan: NotANumber, names: Sequence[str], agents: Sequence[str]) -> str:
    """What was not a number first; of the same point, what the rest was made of."""
    found = []
    for rank, (what, first) in enumerate(zip(nan._fields, nan, strict=True)):
        if np.isfinite(first).any():
            row, agent = divmod(int(np.argmin(first)), first.shape[-1])
            found.append((float(np.min(first)), rank, what, row, agent))
    tau, _, what, row, agent = min(found)
    name = names[row] if len(names) else ""
    text = {
        "drift": "the field is not a finite number",
        "value": f"the value of {name} is not a number",
        "gradient": f"the gradient of {name} is not a number",
        "input": "the input is not a number",
    }[what]
    return f"{text} at {agents[agent]}, tau = {tau:.3g}"


def foreign_record(summary: Summary, why: str) -> GenerationRecord:
    """The record of a generation that says nothing of the requirements asked about."""
    work = summary.work
    return GenerationRecord(
        held=False, broken=why, requirements=(), steps=int(summary.points) - 1,
        refused=int(work.refused), forced=int(work.forced), least_sine=None,
        effort=finite(np.max(summary.effort, initial=0.0)),
        largest_step=finite(summary.largest_step),
    )  # fmt: skip


def verdicts_of(
    margins_of_rows: Sequence[Any],
    guidance: DecoupledGuidance,
    agents: Sequence[str] | None,
) -> tuple[RequirementVerdict, ...]:
    """Of every requirement: its least margin, and who misses it."""
    out = []
    for name, margins, labels in zip(
        guidance.names, margins_of_rows, guidance.margin_names(), strict=True
    ):
        if np.ndim(margins) == 0:
            out.append(_team_verdict(name, float(margins)))
        else:
            out.append(_agents_verdict(name, np.asarray(margins), labels, agents))
    return tuple(out)


def _team_verdict(name: str, margin: float) -> RequirementVerdict:
    if math.isnan(margin):
        return RequirementVerdict(name, -1e12, f"the value of {name} is not a number")
    text = None if margin >= 0 else f"{name} ends above its bound by {-margin:.6g}"
    return RequirementVerdict(name, finite(margin), text)


def _agents_verdict(
    name: str,
    margins: Float[np.ndarray, "agents margins"],
    labels: Sequence[str] | None,
    agents: Sequence[str] | None,
) -> RequirementVerdict:
    known = np.where(np.isnan(margins), -np.inf, margins)
    agent, column = divmod(int(known.argmin()), margins.shape[1])
    who = f"agent {agent}" if agents is None else agents[agent]
    if np.isnan(margins[agent, column]):
        return RequirementVerdict(name, -1e12, f"the margins of {name} are not a number at {who}")
    least = finite(known[agent, column])
    if least >= 0:
        return RequirementVerdict(name, least, None)
    which = "" if labels is None else f" ({labels[column]})"
    return RequirementVerdict(name, least, f"{who} misses {name}{which} by {-least:.6g}")
