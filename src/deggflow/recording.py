"""Certificates in words: what a summary says of a generation, and what margins say of its end."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from .certificate import (
    GenerationRecord,
    LostAgent,
    RequirementRecord,
    RequirementVerdict,
    TraceRecord,
    count_points,
)
from .divergence import END_OF_SCALE, finite
from .guidance import MarginLabel
from .guidance.requirement import MarginNames
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
    batch, traces = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (summary, trace))
    [made] = records(batch, names, [agents], traces)
    return made


def records(
    summary: Summary,
    names: Sequence[str],
    agents: Sequence[Sequence[str] | None],
    trace: Trace | None = None,
) -> list[GenerationRecord]:
    """The records of a batch, as `record` makes them of its samples one by one.

    Args:
        summary: Numpy arrays with a leading axis of samples.
        names: Of the requirements, one per row.
        agents: For each sample, what to call the agents.
        trace: Also kept, if given; with a leading axis of samples.
    """
    count, team = summary.qp_infeasible_points.shape
    labels = [agent_names(each, team) for each in agents]
    rows = [_requirement_records(summary, row, name, labels) for row, name in enumerate(names)]
    work, hold = summary.work, summary.hypotheses_hold.tolist()
    # Lists of Python's own numbers: to take them from arrays one by one takes several times as long.
    points, refused, forced = (
        leaf.tolist() for leaf in (summary.points, work.refused_steps, work.forced_steps)
    )
    sine, step = summary.least_opposed_sine.tolist(), summary.largest_step.tolist()
    largest_input_norm = summary.largest_input_norm.max(axis=-1, initial=0.0).tolist()

    def of(k: int) -> GenerationRecord:
        def alone(whole: Any) -> Any:
            return jax.tree.map(lambda leaf: leaf[k], whole)

        return GenerationRecord(
            hypotheses_hold=hold[k],
            first_failure=None if hold[k] else _first_failure(alone(summary), names, labels[k]),
            requirements=tuple(row[k] for row in rows),
            steps=points[k] - 1,
            refused_steps=refused[k],
            forced_steps=forced[k],
            least_opposed_sine=sine[k] if sine[k] < 1 else None,
            largest_input_norm=finite(largest_input_norm[k]),
            largest_step=finite(step[k]),
            trace=None if trace is None else _trace_record(alone(trace)),
        )

    return [of(k) for k in range(count)]


def _requirement_records(
    summary: Summary, row: int, name: str, agents: Sequence[Sequence[str]]
) -> list[RequirementRecord]:
    """Of one requirement, for each sample."""
    forced = summary.forced_steps[:, row]
    columns = (
        summary.value, summary.limit, summary.excess, summary.active_points,
        summary.smallest_ell_norm, summary.kink_points,
    )  # fmt: skip
    numbers = zip(
        *(column[:, row].tolist() for column in columns),
        forced.max(axis=-1, initial=0).tolist(),
        strict=True,
    )
    return [
        RequirementRecord(
            name,
            value=finite(value),
            limit=finite(limit),
            excess=finite(excess),
            active_points=active,
            smallest_ell_norm=finite(ell_norm) if math.isfinite(ell_norm) else None,
            forced_steps=most,
            forced_agents=tuple(agents[k][int(i)] for i in np.flatnonzero(forced[k]))
            if most
            else (),
            kink_points=kinks,
        )
        for k, (value, limit, excess, active, ell_norm, kinks, most) in enumerate(numbers)
    ]


def agent_names(agents: Sequence[str] | None, count: int) -> list[str]:
    """What agents are called; those without a name, by their number."""
    labels = list(agents or ())
    return labels + [f"agent {k}" for k in range(len(labels), count)]


def lost_agents(
    stops: Float[np.ndarray, " agents"], agents: Sequence[str] | None = None
) -> tuple[LostAgent, ...]:
    """Who was lost.

    Args:
        stops: tau at which each agent was lost; infinite if it was not.
        agents: What to call the agents; "agent 0", ... if None.
    """
    labels = agent_names(agents, len(stops))
    lost = np.flatnonzero(np.isfinite(stops))
    return tuple(LostAgent(labels[int(k)], float(stops[k])) for k in lost)


def _trace_record(trace: Trace) -> TraceRecord:
    def rows(values: Float[Array | np.ndarray, "points rows"]) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(finite(x) for x in row) for row in np.asarray(values, np.float64))

    tau = tuple(np.asarray(trace.tau, np.float64).tolist())
    return TraceRecord(tau, rows(trace.value), rows(trace.bound), rows(trace.limit))


def _first_failure(summary: Any, names: Sequence[str], agents: Sequence[str]) -> str:
    """The hypothesis that failed first, in the order in which one leads to the next."""
    if summary.not_a_number:
        return not_a_number(summary.nan, names, agents)
    if summary.qp_infeasible_points.any():
        agent = int(summary.qp_infeasible_points.argmax())
        count = count_points(summary.qp_infeasible_points[agent])
        return f"no input of {agents[agent]} met all its rows at {count}"
    if summary.infeasible_points.any():
        row, agent = divmod(int(summary.infeasible_points.argmax()), len(agents))
        count = count_points(summary.infeasible_points[row, agent])
        return f"{agents[agent]} did not meet its row of {names[row]} at {count}"
    row, forced_steps = int(summary.excess.argmax()), int(summary.work.forced_steps)
    texts = []
    if summary.excess[row] > 0:
        texts.append(f"{names[row]} was above its limit by {finite(summary.excess[row]):.3g}")
    if forced_steps:
        where = _forced_at(summary.forced_steps, names, agents)
        texts.append(f"{forced_steps} steps were forced{where}")
    if summary.kink_points.any():
        row = int(summary.kink_points.argmax())
        count = count_points(summary.kink_points[row])
        texts.append(f"{names[row]} has no gradient (a kink) at {count}")
    if not summary.ordered:
        texts.append("tau did not increase from each point to the next")
    return ", ".join(texts)


def _forced_at(
    forced_steps: np.ndarray, names: Sequence[str], agents: Sequence[str], most: int = 4
) -> str:
    """The requirements and agents to which forced steps are ascribed."""
    parts = []
    for row in np.flatnonzero(forced_steps.any(axis=1)):
        order = np.argsort(-forced_steps[row], kind="stable")
        labels = [agents[int(k)] for k in order if forced_steps[row, k]]
        more = f" and {len(labels) - most} more" if len(labels) > most else ""
        parts.append(f"{names[int(row)]} at {', '.join(labels[:most])}{more}")
    return f": {'; '.join(parts)}" if parts else ""


def not_a_number(nan: NotANumber, names: Sequence[str], agents: Sequence[str]) -> str:
    """What was not a number first; of the same point, what the rest was made of."""
    places = []
    for rank, (what, first) in enumerate(zip(nan._fields, nan, strict=True)):
        if np.isfinite(first).any():
            row, agent = divmod(int(np.argmin(first)), first.shape[-1])
            places.append((float(np.min(first)), rank, what, row, agent))
    tau, _, what, row, agent = min(places)
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
        hypotheses_hold=False, first_failure=why, requirements=(),
        steps=int(summary.points) - 1, refused_steps=int(work.refused_steps),
        forced_steps=int(work.forced_steps), least_opposed_sine=None,
        largest_input_norm=finite(np.max(summary.largest_input_norm, initial=0.0)),
        largest_step=finite(summary.largest_step),
    )  # fmt: skip


def verdicts_of(
    margins_of_rows: Sequence[Any],
    names: Sequence[str],
    labels: Sequence[MarginNames | None],
    agents: Sequence[str] | None,
) -> tuple[RequirementVerdict, ...]:
    """Of every requirement: its least margin, and who misses it.

    Args:
        margins_of_rows: Of one sample.
        names: Of the requirements, one per row.
        labels: Names of each requirement's margins, as `DecoupledGuidance.margin_names` has them.
        agents: What to call the agents; "agent 0", ... if None.
    """
    out = []
    for name, margins, own in zip(names, margins_of_rows, labels, strict=True):
        if np.ndim(margins) == 0:
            out.append(_team_verdict(name, float(margins)))
        else:
            out.append(_agents_verdict(name, np.asarray(margins), own, agents))
    return tuple(out)


def _team_verdict(name: str, margin: float) -> RequirementVerdict:
    if math.isnan(margin):
        return RequirementVerdict(name, -END_OF_SCALE, f"the value of {name} is not a number")
    text = None if margin >= 0 else f"{name} ends above its bound by {-margin:.6g}"
    return RequirementVerdict(name, finite(margin), text)


def _agents_verdict(
    name: str,
    margins: Float[np.ndarray, "agents margins"],
    names: MarginNames | None,
    agents: Sequence[str] | None,
) -> RequirementVerdict:
    numbers = np.where(np.isnan(margins), -np.inf, margins)
    agent, column = divmod(int(numbers.argmin()), margins.shape[1])
    who = agent_names(agents, len(margins))
    if np.isnan(margins[agent, column]):
        return RequirementVerdict(
            name, -END_OF_SCALE, f"the margins of {name} are not a number at {who[agent]}"
        )
    least = finite(numbers[agent, column])
    if least >= 0:
        return RequirementVerdict(name, least, None)
    label = MarginLabel("", "") if names is None else names(column, margins.shape[1], who)
    which, unit = f" ({label.text})" if label.text else "", f" {label.unit}" if label.unit else ""
    return RequirementVerdict(
        name, least, f"{who[agent]} misses {name}{which} by {-least:.6g}{unit}"
    )
