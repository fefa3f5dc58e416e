"""Certificates and records of generations as they stand in files: what is accepted, and what is refused and why."""

from typing import Any

from .certificate import (
    Certificate,
    GenerationRecord,
    RequirementRecord,
    RequirementVerdict,
    TraceRecord,
)
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

MAX_DRAWS = 10_000  # as `generate` allows
MAX_STEPS = 10**9
_ANY = 1e12  # for values, limits and margins


def parse_certificate(value: Any, field: str) -> Certificate:
    """A certificate from its JSON object; raises `InputError` with the field."""
    keys = ("satisfied", "min_margin", "violation", "draws", "reason")
    given = expect_object(value, field, (*keys, "generation", "verdicts"), keys)
    made = given.get("generation")
    return Certificate(
        expect_flag(given["satisfied"], join(field, "satisfied")),
        expect_number(given["min_margin"], join(field, "min_margin"), -_ANY, _ANY, ""),
        expect_number(given["violation"], join(field, "violation"), -_ANY, _ANY, ""),
        expect_integer(given["draws"], join(field, "draws"), 1, MAX_DRAWS),
        expect_reason(given["reason"], join(field, "reason")),
        None if made is None else parse_generation(made, join(field, "generation")),
        tuple(
            _verdict(item, f"{field}.verdicts[{k}]")
            for k, item in enumerate(
                expect_list(given.get("verdicts", []), join(field, "verdicts"))
            )
        ),
    )


def _verdict(item: Any, field: str) -> RequirementVerdict:
    keys = ("name", "margin", "reason")
    given = expect_object(item, field, keys, keys)
    return RequirementVerdict(
        expect_text(given["name"], join(field, "name")),
        expect_number(given["margin"], join(field, "margin"), -_ANY, _ANY, ""),
        expect_reason(given["reason"], join(field, "reason")),
    )


def parse_generation(value: Any, field: str) -> GenerationRecord:
    """A record of a generation from its JSON object; raises `InputError` with the field."""
    counts = ("steps", "refused", "forced")
    keys = ("held", "broken", "requirements", *counts, "least_sine", "effort")
    # Files of earlier versions have no `largest_step`.
    given = expect_object(value, field, (*keys, "largest_step", "trace"), keys)
    requirements = expect_list(given["requirements"], join(field, "requirements"))
    trace = given.get("trace")
    steps, refused, forced = (
        expect_integer(given[key], join(field, key), 0, MAX_STEPS) for key in counts
    )
    return GenerationRecord(
        expect_flag(given["held"], join(field, "held")),
        expect_reason(given["broken"], join(field, "broken")),
        tuple(
            _requirement(item, f"{field}.requirements[{k}]") for k, item in enumerate(requirements)
        ),
        steps,
        refused,
        forced,
        _number_or_none(given["least_sine"], join(field, "least_sine"), 0.0, 1.0),
        expect_number(given["effort"], join(field, "effort"), 0.0, _ANY, ""),
        _number_or_none(given.get("largest_step"), join(field, "largest_step"), 0.0, _ANY),
        None if trace is None else _trace(trace, join(field, "trace"), len(requirements)),
    )


def _requirement(item: Any, field: str) -> RequirementRecord:
    numbers = ("value", "limit", "excess")
    keys = ("name", *numbers, "active", "smallest_ell")
    later = ("forced", "forced_agents", "kinks")  # files of earlier versions have none of them
    given = expect_object(item, field, (*keys, *later), keys)
    agents = expect_list(given.get("forced_agents", []), join(field, "forced_agents"))
    value, limit, excess = (
        expect_number(given[key], join(field, key), -_ANY, _ANY, "") for key in numbers
    )
    return RequirementRecord(
        expect_text(given["name"], join(field, "name")),
        value,
        limit,
        excess,
        expect_integer(given["active"], join(field, "active"), 0, MAX_STEPS),
        _number_or_none(given["smallest_ell"], join(field, "smallest_ell"), 0.0, _ANY),
        expect_integer(given.get("forced", 0), join(field, "forced"), 0, MAX_STEPS),
        tuple(expect_text(each, f"{field}.forced_agents[{k}]") for k, each in enumerate(agents)),
        expect_integer(given.get("kinks", 0), join(field, "kinks"), 0, MAX_STEPS),
    )


def _trace(value: Any, field: str, rows: int) -> TraceRecord:
    parts = ("value", "bound", "limit")
    given = expect_object(value, field, ("tau", *parts), ("tau", *parts))
    tau = _numbers(given["tau"], join(field, "tau"))
    tables = [_table(given[part], join(field, part), len(tau), rows) for part in parts]
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
