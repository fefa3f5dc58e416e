"""Contradictions within a line of a file, and between a line and its requested condition.

Works on JSON values that `records` has accepted, and shares no code with the code that writes them.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from .jsonl import join, shorten

ROUNDING = 5e-7  # relative, of float32 numbers, in which generations run

Line = Mapping[str, Any]  # a JSON object
Unverified = Mapping[str, str]
"""Fields that can't be verified from a file, or only in part; the value is a remark on that, or empty."""

RECORD: Unverified = {
    "first_failure": "except for the numbers that other fields repeat",
    "requirements[].limit": "",
    "requirements[].excess": "except that it covers the end and the trace",
    "requirements[].active_points": "",
    "requirements[].smallest_ell_norm": "",
    "requirements[].forced_steps": "",
    "requirements[].forced_agents": "except that they exist",
    "requirements[].kink_points": "",
    "steps": "",
    "refused_steps": "",
    "forced_steps": "",
    "least_opposed_sine": "",
    "largest_input_norm": "",
    "largest_step": "",
    "lost": "",
    "trace": "before its end",
}
"""Fields of a generation's record that depend on points which the line does not hold."""


def unverified_record(field: str) -> Unverified:
    """`RECORD` of a generation's record that stands in a field of the line."""
    return {f"{field}.{name}": remark for name, remark in RECORD.items()}


RESULT: Unverified = {
    "seed": "",
    "certificate.draws": "",
    "certificate.verdicts": "",
    "certificate.generation": "that it is there",
    **unverified_record("certificate.generation"),
}
"""Fields of a result with one certificate on which nothing else in its line depends."""


def unverified_line(fields: Unverified) -> str:
    """The fields in one line of text, with those of a record in braces."""
    of_records: dict[str, list[str]] = {}
    for field, remark in fields.items():
        head, _, name = field.rpartition("generation.")
        entry = f"{name} ({remark})" if remark else name
        of_records.setdefault(f"{head}generation." if head else "", []).append(entry)
    alone = of_records.pop("", [])
    groups = [f"{head}{{{', '.join(names)}}}" for head, names in of_records.items()]
    return f"Cannot be verified from the file: {', '.join([*alone, *groups])}."


class Wrong(NamedTuple):
    """A false statement of a line.

    Attributes:
        field: Name of the field.
        text: What is wrong with it.
    """

    field: str
    text: str

    def __str__(self) -> str:
        """The message that `certify` prints."""
        return f"field `{self.field}` {self.text}"


def check_claim(certificate: Line, field: str) -> Iterator[Wrong]:
    """Contradictions between a certificate's `satisfied`, its `reason` and its verdicts."""
    satisfied, reason = certificate["satisfied"], certificate["reason"]
    if satisfied and reason is not None:
        yield Wrong(join(field, "reason"), "names a violation, though `satisfied` is true")
    if not satisfied and not reason:
        yield Wrong(join(field, "reason"), "must name a violation, as `satisfied` is false")
    for k, each in enumerate(certificate.get("verdicts", [])):
        if (each["margin"] >= 0) != (each["reason"] is None):
            yield Wrong(f"{field}.verdicts[{k}].reason", "contradicts the margin beside it")
        if satisfied and each["margin"] < 0:
            yield Wrong(f"{field}.verdicts[{k}].margin", "is negative, though `satisfied` is true")


def check_result(
    certificate: Line,
    field: str,
    *,
    holds: bool | None,
    reasons: Sequence[str],
    margin: float,
    tolerance: float,
    unit: str,
) -> Iterator[Wrong]:
    """Contradictions between a certificate and what its result is found to be.

    Args:
        certificate: The certificate.
        field: Its name, for messages.
        holds: Whether the result satisfies its requirements; None: it is no result, as its generation diverged.
        reasons: What its `reason` may be if it does not, the likeliest first.
        margin: Its least margin.
        tolerance: For the margin's rounding.
        unit: Of the margin.
    """
    if holds is not None and certificate["satisfied"] != holds:
        text = "is false, but all requirements hold" if holds else "is true, but one is missed"
        yield Wrong(join(field, "satisfied"), text)
    yield from check_claim(certificate, field)
    reason = certificate["reason"]
    if reason is not None and holds is False and reason not in reasons:
        yield Wrong(join(field, "reason"), f"is not what is found: {shorten(reasons[0], 300)}")
    if not abs(certificate["min_margin"] - margin) <= tolerance:
        yield Wrong(join(field, "min_margin"), f"is not the least margin, {margin:.9g} {unit}")


def found_reason(found: str, generation: Line | None) -> str:
    """A certificate's reason: what is found, and the first failure on the way, if a generation had one."""
    if generation is not None and generation["first_failure"]:
        return f"{found}; on the way {generation['first_failure']}"
    return found


def check_generation(
    record: Line, field: str, names: Sequence[str], agents: Sequence[str]
) -> Iterator[Wrong]:
    """Contradictions within the record of a generation.

    Args:
        record: The record.
        field: Its name, for messages.
        names: Names of the condition's requirements, in order.
        agents: Names of the agents.
    """
    rows, forced_steps = record["requirements"], record["forced_steps"]
    row_names = [row["name"] for row in rows]
    if row_names != list(names):
        text = f"is of {_listed(row_names)}; the condition requires {_listed(names)}"
        yield Wrong(join(field, "requirements"), text)
    yield from _hypotheses(record, field)
    for k, row in enumerate(rows):
        yield from _requirement(record, row, f"{field}.requirements[{k}]", agents)
    if forced_steps > record["steps"]:
        text = f"is more than the {record['steps']} steps taken"
        yield Wrong(join(field, "forced_steps"), text)
    if record["least_opposed_sine"] is not None and len(rows) == 1:
        text = "must be null, as a single requirement has no opposed rows"
        yield Wrong(join(field, "least_opposed_sine"), text)
    yield from _inputs(record, field)
    if "trace" in record:
        yield from _trace(record, record["trace"], join(field, "trace"))


def _listed(names: Iterable[str]) -> str:
    return ", ".join(shorten(name) for name in names) or "nothing"


def _hypotheses(record: Line, field: str) -> Iterator[Wrong]:
    hold, failure, rows = (
        record[name] for name in ("hypotheses_hold", "first_failure", "requirements")
    )
    if hold and failure is not None:
        text = "names a failure, though `hypotheses_hold` is true"
        yield Wrong(join(field, "first_failure"), text)
    if not hold and not failure:
        text = "must name a failure, as `hypotheses_hold` is false"
        yield Wrong(join(field, "first_failure"), text)
    if hold and record["forced_steps"]:
        yield Wrong(join(field, "forced_steps"), "is not 0, though `hypotheses_hold` is true")
    for k, row in enumerate(rows if hold else []):
        for name in ("excess", "forced_steps", "kink_points"):
            if row.get(name, 0) > 0:
                place = f"{field}.requirements[{k}].{name}"
                yield Wrong(place, "is above 0, though `hypotheses_hold` is true")
    if failure and rows:
        yield from _first_failure(record, join(field, "first_failure"))


_ABOVE = re.compile(r"(?:^|, )([^,;:]+) was above its limit by ([-+.0-9e]+)")
_FORCED = re.compile(r"(?:^|, )([0-9]+) steps were forced")
_FIRST = re.compile(r"no input of | did not meet its row of |is not a (finite )?number at ")
_POINTS = re.compile(r" at ([0-9]{1,10}) points?")


def _first_failure(record: Line, field: str) -> Iterator[Wrong]:
    """Contradictions between the text on the first failure and the numbers that it repeats."""
    text, rows = record["first_failure"], record["requirements"]
    counts = [int(count) for count in _POINTS.findall(text)]
    if max(counts, default=0) > record["steps"] + 1:
        yield Wrong(field, f"counts more points than the generation has, {record['steps'] + 1}")
    if _FIRST.search(text):
        return
    worst = max(rows, key=lambda row: float(row["excess"]))
    above, forced = _ABOVE.search(text), _FORCED.search(text)
    words = None if above is None else above.groups()
    if words != ((worst["name"], f"{worst['excess']:.3g}") if worst["excess"] > 0 else None):
        yield Wrong(field, "contradicts the greatest `excess` of the requirements")
    if int(forced[1] if forced else 0) != record["forced_steps"]:
        yield Wrong(field, f"contradicts `forced_steps`, which is {record['forced_steps']}")
    if ("has no gradient (a kink)" in text) != any(row.get("kink_points", 0) for row in rows):
        yield Wrong(field, "contradicts the `kink_points` of the requirements")


def _requirement(record: Line, row: Line, field: str, agents: Sequence[str]) -> Iterator[Wrong]:
    value, limit, excess = row["value"], row["limit"], row["excess"]
    if excess < value - limit - ROUNDING * (abs(value) + abs(limit)):
        yield Wrong(
            join(field, "excess"), f"is less than value - limit at the end, {value - limit:.6g}"
        )
    for name in ("active_points", "kink_points"):
        if row.get(name, 0) > record["steps"] + 1:
            text = f"is more than the generation has points, {record['steps'] + 1}"
            yield Wrong(join(field, name), text)
    forced, names = row.get("forced_steps", 0), row.get("forced_agents", [])
    if forced > record["forced_steps"]:
        text = f"is more than all forced steps, {record['forced_steps']}"
        yield Wrong(join(field, "forced_steps"), text)
    if bool(forced) != bool(names):
        text = f"contradicts `forced_steps`, which is {forced}"
        yield Wrong(join(field, "forced_agents"), text)
    for k, name in enumerate(names):
        if name not in agents:
            text = f"is {shorten(name)}, which is no agent of the condition"
            yield Wrong(f"{field}.forced_agents[{k}]", text)


def _inputs(record: Line, field: str) -> Iterator[Wrong]:
    """Contradictions about inputs: a nonzero input follows from a row, in which some agent had to act."""
    rows, input_norm = record["requirements"], record["largest_input_norm"]
    active = any(row["active_points"] for row in rows)
    if active and not input_norm > 0:
        yield Wrong(join(field, "largest_input_norm"), "is 0, though some row was active")
    guided = input_norm > 0 or active
    idle = all(row["smallest_ell_norm"] is None for row in rows)
    if record["hypotheses_hold"] and rows and guided and idle:
        text = "report that no agent had to act, although inputs are not zero"
        yield Wrong(join(field, "requirements"), text)


def _trace(record: Line, trace: Line, field: str) -> Iterator[Wrong]:
    """Contradictions between the trace and the record's values at the end and greatest excess."""
    tau = trace["tau"]
    if len(tau) < 2 or (tau[0], tau[-1]) != (0, 1) or any(b <= a for a, b in pairwise(tau)):
        yield Wrong(join(field, "tau"), "must increase from 0 to 1")
        return
    if len(tau) > record["steps"] + 1:
        yield Wrong(join(field, "tau"), f"has more points than {record['steps']} steps reach")
    for k, row in enumerate(record["requirements"]):
        for name in ("value", "limit"):
            if trace[name][-1][k] != row[name]:
                text = f"differs from `requirements[{k}].{name}`, {row[name]:.6g}"
                yield Wrong(f"{field}.{name}[{len(tau) - 1}][{k}]", text)
        for point, (values, limits) in enumerate(zip(trace["value"], trace["limit"], strict=True)):
            value, limit = values[k], limits[k]
            if value - limit > row["excess"] + ROUNDING * (abs(value) + abs(limit)):
                text = f"is above the limit there by more than `requirements[{k}].excess`"
                yield Wrong(f"{field}.value[{point}][{k}]", text)


def first_difference(expected: Any, actual: Any, field: str = "") -> Wrong | None:
    """The first place in which two JSON values differ; numbers are compared as numbers."""
    if isinstance(expected, Mapping) and isinstance(actual, Mapping):
        keys: Iterable[Any] = [*expected, *(key for key in actual if key not in expected)]
        for key in keys:
            place = join(field, key)
            if key not in actual:
                return Wrong(place, f"is missing; {shorten(expected[key])} was requested")
            if key not in expected:
                return Wrong(place, f"is {shorten(actual[key])}, which was not requested")
            difference = first_difference(expected[key], actual[key], place)
            if difference is not None:
                return difference
        return None
    if isinstance(expected, list | tuple) and isinstance(actual, list | tuple):
        for k, (one, other) in enumerate(zip(expected, actual, strict=False)):
            difference = first_difference(one, other, f"{field}[{k}]")
            if difference is not None:
                return difference
        if len(expected) != len(actual):
            return Wrong(field, f"has {len(actual)} entries; {len(expected)} were requested")
        return None
    if expected == actual:
        return None
    return Wrong(field, f"is {shorten(actual)}; {shorten(expected)} was requested")
