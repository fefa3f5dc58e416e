"""Parses certificates and records of generations from JSON values; errors name the field."""

from collections.abc import Sequence
from typing import Any

from .certificate import (
    Certificate,
    GenerationRecord,
    LostAgent,
    RequirementRecord,
    RequirementVerdict,
    TraceRecord,
)
from .divergence import END_OF_SCALE
from .jsonl import (
    InputError,
    expect_flag,
    expect_integer,
    expect_list,
    expect_number,
    expect_object,
    expect_reason,
    expect_text,
    join,
)

MAX_DRAWS = 10_000  # limit of `generate`
MAX_STEPS = 10**9
_ANY = END_OF_SCALE  # bound of values, limits and margins

# Keys of records in files of earlier versions, which have been renamed.
_OLD_OF_GENERATIONS = ("held", "broken", "refused", "forced", "least_sine", "effort")
_OLD_OF_REQUIREMENTS = ("active", "smallest_ell", "forced", "kinks")


def parse_certificate(value: Any, field: str) -> Certificate:
    """A certificate from its JSON object; raises `InputError` with the field."""
    keys = ("satisfied", "min_margin", "violation", "draws", "reason")
    line = expect_object(value, field, (*keys, "generation", "verdicts"), keys)
    generation, verdicts = line.get("generation"), line.get("verdicts", [])
    return Certificate(
        expect_flag(line["satisfied"], join(field, "satisfied")),
        expect_number(line["min_margin"], join(field, "min_margin"), -_ANY, _ANY, ""),
        expect_number(line["violation"], join(field, "violation"), -_ANY, _ANY, ""),
        expect_integer(line["draws"], join(field, "draws"), 1, MAX_DRAWS),
        expect_reason(line["reason"], join(field, "reason")),
        None if generation is None else parse_generation(generation, join(field, "generation")),
        tuple(
            _verdict(item, f"{field}.verdicts[{k}]")
            for k, item in enumerate(expect_list(verdicts, join(field, "verdicts")))
        ),
    )


def _verdict(item: Any, field: str) -> RequirementVerdict:
    keys = ("name", "margin", "reason")
    verdict = expect_object(item, field, keys, keys)
    return RequirementVerdict(
        expect_text(verdict["name"], join(field, "name")),
        expect_number(verdict["margin"], join(field, "margin"), -_ANY, _ANY, ""),
        expect_reason(verdict["reason"], join(field, "reason")),
    )


def parse_generation(value: Any, field: str) -> GenerationRecord:
    """A record of a generation from its JSON object; raises `InputError` with the field."""
    _refuse_old_names(value, field, _OLD_OF_GENERATIONS)
    counts = ("steps", "refused_steps", "forced_steps")
    sizes = ("least_opposed_sine", "largest_input_norm", "largest_step")
    keys = ("hypotheses_hold", "first_failure", "requirements", *counts, *sizes)
    record = expect_object(value, field, (*keys, "trace", "lost"), keys)
    requirements = expect_list(record["requirements"], join(field, "requirements"))
    trace = record.get("trace")
    steps, refused_steps, forced_steps = (
        expect_integer(record[key], join(field, key), 0, MAX_STEPS) for key in counts
    )
    sine, *norms = sizes
    largest_input_norm, largest_step = (
        expect_number(record[key], join(field, key), 0.0, _ANY, "") for key in norms
    )
    return GenerationRecord(
        expect_flag(record["hypotheses_hold"], join(field, "hypotheses_hold")),
        expect_reason(record["first_failure"], join(field, "first_failure")),
        tuple(
            _requirement(item, f"{field}.requirements[{k}]") for k, item in enumerate(requirements)
        ),
        steps,
        refused_steps,
        forced_steps,
        _number_or_none(record[sine], join(field, sine), 0.0, 1.0),
        largest_input_norm,
        largest_step,
        None if trace is None else _trace(trace, join(field, "trace"), len(requirements)),
        tuple(
            _lost_agent(item, f"{field}.lost[{k}]")
            for k, item in enumerate(expect_list(record.get("lost", []), join(field, "lost")))
        ),
    )


def _lost_agent(item: Any, field: str) -> LostAgent:
    keys = ("agent", "tau")
    lost = expect_object(item, field, keys, keys)
    return LostAgent(
        expect_text(lost["agent"], join(field, "agent")),
        expect_number(lost["tau"], join(field, "tau"), 0.0, 1.0, ""),
    )


def _requirement(item: Any, field: str) -> RequirementRecord:
    _refuse_old_names(item, field, _OLD_OF_REQUIREMENTS)
    numbers = ("value", "limit", "excess")
    keys = ("name", *numbers, "active_points", "smallest_ell_norm")
    unless_zero = ("forced_steps", "forced_agents", "kink_points")
    record = expect_object(item, field, (*keys, *unless_zero), keys)
    agents = expect_list(record.get("forced_agents", []), join(field, "forced_agents"))
    value, limit, excess = (
        expect_number(record[key], join(field, key), -_ANY, _ANY, "") for key in numbers
    )
    active_points, forced_steps, kink_points = (
        expect_integer(record.get(key, 0), join(field, key), 0, MAX_STEPS)
        for key in ("active_points", "forced_steps", "kink_points")
    )
    ell_norm = record["smallest_ell_norm"]
    return RequirementRecord(
        expect_text(record["name"], join(field, "name")),
        value,
        limit,
        excess,
        active_points,
        _number_or_none(ell_norm, join(field, "smallest_ell_norm"), 0.0, _ANY),
        forced_steps,
        tuple(expect_text(each, f"{field}.forced_agents[{k}]") for k, each in enumerate(agents)),
        kink_points,
    )


def _refuse_old_names(value: Any, field: str, names: Sequence[str]) -> None:
    old = [name for name in names if isinstance(value, dict) and name in value]
    if old:
        raise InputError(
            f"the record has names of an older version ({', '.join(old)}): rerun `generate`, "
            "or remove `generation` to certify without the record",
            field=field,
        )


def _trace(value: Any, field: str, rows: int) -> TraceRecord:
    parts = ("value", "bound", "limit")
    trace = expect_object(value, field, ("tau", *parts), ("tau", *parts))
    tau = _numbers(trace["tau"], join(field, "tau"))
    tables = [_table(trace[part], join(field, part), len(tau), rows) for part in parts]
    return TraceRecord(tau, *tables)


def _table(value: Any, field: str, points: int, rows: int) -> tuple[tuple[float, ...], ...]:
    lines = expect_list(value, field)
    table = tuple(_numbers(line, f"{field}[{k}]") for k, line in enumerate(lines))
    if len(table) != points or any(len(line) != rows for line in table):
        raise InputError(f"must hold {rows} numbers at each of {points} values of tau", field=field)
    return table


def _numbers(value: Any, field: str) -> tuple[float, ...]:
    return tuple(
        expect_number(item, f"{field}[{k}]", -_ANY, _ANY, "")
        for k, item in enumerate(expect_list(value, field))
    )


def _number_or_none(value: Any, field: str, low: float, high: float) -> float | None:
    return None if value is None else expect_number(value, field, low, high, "")
