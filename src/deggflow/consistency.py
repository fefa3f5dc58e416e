"""What a line of a file says twice, and whether it says the same: records of generations, and lines against what was asked.

Works on JSON values that `records` has accepted, and shares no code with what writes them.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from .jsonl import join, shorten

ROUNDING = 5e-7  # of a number in float32, in which generations run

Line = Mapping[str, Any]  # a JSON object
Unverified = Mapping[str, str]
"""Fields that no file can show to be true, or not wholly; of some it is said why, or what is found all the same."""

RECORD: Unverified = {
    "first_failure": "its words, but for the numbers that stand beside it",
    "requirements[].limit": "",
    "requirements[].excess": "but that it covers the end and the trace",
    "requirements[].active_points": "",
    "requirements[].smallest_ell_norm": "",
    "requirements[].forced_steps": "",
    "requirements[].forced_agents": "but that they exist",
    "requirements[].kink_points": "",
    "steps": "",
    "refused_steps": "",
    "forced_steps": "",
    "least_opposed_sine": "",
    "largest_input_norm": "",
    "largest_step": "",
    "trace": "before its end",
}
"""Of a generation's record: what is of points that no line holds."""


def unverified_line(fields: Unverified) -> str:
    """These fields in one line; those of a record in braces."""
    of_records: dict[str, list[str]] = {}
    for field, remark in fields.items():
        head, _, name = field.rpartition("generation.")
        entry = f"{name} ({remark})" if remark else name
        of_records.setdefault(f"{head}generation." if head else "", []).append(entry)
    alone = of_records.pop("", [])
    groups = [f"{head}{{{', '.join(names)}}}" for head, names in of_records.items()]
    return f"Not to be verified from the file: {', '.join([*alone, *groups])}."


class Wrong(NamedTuple):
    """One thing a line says that can't be so."""

    field: str
    text: str

    def __str__(self) -> str:
        """As it is told of a line."""
        return f"field `{self.field}` {self.text}"


def check_claim(certificate: Line, field: str) -> Iterator[Wrong]:
    """Satisfied and no reason, or a reason; and what is said of each requirement."""
    satisfied, reason = certificate["satisfied"], certificate["reason"]
    if satisfied and reason is not None:
        yield Wrong(join(field, "reason"), "says what is missed, though `satisfied` is true")
    if not satisfied and not reason:
        yield Wrong(join(field, "reason"), "must say what is missed, as `satisfied` is false")
    for k, each in enumerate(certificate.get("verdicts", [])):
        if (each["margin"] >= 0) != (each["reason"] is None):
            yield Wrong(f"{field}.verdicts[{k}].reason", "and the margin beside it contradict")
        if satisfied and each["margin"] < 0:
            yield Wrong(f"{field}.verdicts[{k}].margin", "is negative, though `satisfied` is true")


def check_generation(
    record: Line, field: str, names: Sequence[str], agents: Sequence[str]
) -> Iterator[Wrong]:
    """What contradicts itself in the record of a generation.

    Args:
        record: What the line says of the generation.
        field: Where it stands.
        names: Of the requirements that the condition asks for, in order.
        agents: Names of the agents.
    """
    rows, forced_steps = record["requirements"], record["forced_steps"]
    listed = [row["name"] for row in rows]
    if listed != list(names):
        text = f"is of {_listed(listed)}; the condition asks for {_listed(names)}"
        yield Wrong(join(field, "requirements"), text)
    yield from _hypotheses(record, field)
    for k, row in enumerate(rows):
        yield from _requirement(record, row, f"{field}.requirements[{k}]", agents)
    if forced_steps > record["steps"]:
        text = f"is more than the {record['steps']} steps taken"
        yield Wrong(join(field, "forced_steps"), text)
    if record["least_opposed_sine"] is not None and len(rows) == 1:
        text = "must be null: one requirement has nothing opposed"
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
        text = "says what failed, though `hypotheses_hold` is true"
        yield Wrong(join(field, "first_failure"), text)
    if not hold and not failure:
        text = "must say what failed, as `hypotheses_hold` is false"
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
    """The words for what failed first, where they repeat numbers that stand beside them."""
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
        yield Wrong(field, "and the greatest `excess` of the requirements contradict")
    if int(forced[1] if forced else 0) != record["forced_steps"]:
        yield Wrong(field, f"and `forced_steps` contradict, which is {record['forced_steps']}")
    if ("has no gradient (a kink)" in text) != any(row.get("kink_points", 0) for row in rows):
        yield Wrong(field, "and the `kink_points` of the requirements contradict")


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
        text = f"and `forced_steps`, which is {forced}, contradict"
        yield Wrong(join(field, "forced_agents"), text)
    for k, name in enumerate(names):
        if name not in agents:
            text = f"is {shorten(name)}, which is no agent of the condition"
            yield Wrong(f"{field}.forced_agents[{k}]", text)


def _inputs(record: Line, field: str) -> Iterator[Wrong]:
    """An input that is not zero is decided by a row, and somebody had to act."""
    rows, input_norm = record["requirements"], record["largest_input_norm"]
    active = any(row["active_points"] for row in rows)
    if active and not input_norm > 0:
        yield Wrong(join(field, "largest_input_norm"), "is 0, though some row was active")
    acted = input_norm > 0 or active
    idle = all(row["smallest_ell_norm"] is None for row in rows)
    if record["hypotheses_hold"] and rows and acted and idle:
        yield Wrong(
            join(field, "requirements"), "say that no agent had to act, yet inputs were given"
        )


def _trace(record: Line, trace: Line, field: str) -> Iterator[Wrong]:
    """The trace against what the record says of the end and of the greatest excess."""
    tau = trace["tau"]
    if len(tau) < 2 or (tau[0], tau[-1]) != (0, 1) or any(b <= a for a, b in pairwise(tau)):
        yield Wrong(join(field, "tau"), "must increase from 0 to 1")
        return
    if len(tau) > record["steps"] + 1:
        yield Wrong(join(field, "tau"), f"has more points than {record['steps']} steps reach")
    for k, row in enumerate(record["requirements"]):
        for name in ("value", "limit"):
            if trace[name][-1][k] != row[name]:
                text = f"ends otherwise than `requirements[{k}].{name}`, {row[name]:.6g}"
                yield Wrong(f"{field}.{name}[{len(tau) - 1}][{k}]", text)
        for point, (values, limits) in enumerate(zip(trace["value"], trace["limit"], strict=True)):
            value, limit = values[k], limits[k]
            if value - limit > row["excess"] + ROUNDING * (abs(value) + abs(limit)):
                text = f"is above the limit there by more than `requirements[{k}].excess`"
                yield Wrong(f"{field}.value[{point}][{k}]", text)


def first_difference(asked: Any, given: Any, field: str = "") -> Wrong | None:
    """The first place in which two JSON values differ; numbers are compared as numbers."""
    if isinstance(asked, Mapping) and isinstance(given, Mapping):
        keys: Iterable[Any] = [*asked, *(key for key in given if key not in asked)]
        for key in keys:
            place = join(field, key)
            if key not in given:
                return Wrong(place, f"is missing; asked for was {shorten(asked[key])}")
            if key not in asked:
                return Wrong(place, f"is {shorten(given[key])}; nothing like it was asked for")
            difference = first_difference(asked[key], given[key], place)
            if difference is not None:
                return difference
        return None
    if isinstance(asked, list | tuple) and isinstance(given, list | tuple):
        for k, (one, other) in enumerate(zip(asked, given, strict=False)):
            difference = first_difference(one, other, f"{field}[{k}]")
            if difference is not None:
                return difference
        if len(asked) != len(given):
            return Wrong(field, f"has {len(given)} entries; asked for were {len(asked)}")
        return None
    if asked == given:
        return None
    return Wrong(field, f"is {shorten(given)}; asked for was {shorten(asked)}")
