"""Certificates and records of generations as they stand in files: what is valid comes back, what is not is named."""

import copy
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.certificate import Certificate, GenerationRecord, RequirementRecord, TraceRecord
from deggflow.jsonl import InputError, parse_line
from deggflow.records import parse_certificate, parse_generation

NUMBER = st.floats(-1e12, 1e12)
SIZE = st.floats(0, 1e12)
COUNT = st.integers(0, 10**9)
TEXT = st.text(max_size=12)


def read(value):
    """As a file would give it back."""
    return parse_line(json.dumps(value, allow_nan=False).encode())


@st.composite
def generations(draw):
    """Records with any number of requirements, and with a trace of any number of points, or none."""
    rows, points = draw(st.integers(0, 3)), draw(st.integers(0, 4))
    line = st.lists(NUMBER, min_size=rows, max_size=rows)
    table = st.lists(line, min_size=points, max_size=points)
    tau = st.lists(NUMBER, min_size=points, max_size=points)
    trace = {"tau": tau, "value": table, "bound": table, "limit": table}
    requirement = {
        "name": TEXT,
        **dict.fromkeys(("value", "limit", "excess"), NUMBER),
        "active_points": COUNT,
        "smallest_ell_norm": st.one_of(st.none(), SIZE),
    }
    requirements = st.lists(st.fixed_dictionaries(requirement), min_size=rows, max_size=rows)
    return draw(
        st.fixed_dictionaries(
            {
                "hypotheses_hold": st.booleans(),
                "first_failure": st.one_of(st.none(), TEXT),
                "requirements": requirements,
                **dict.fromkeys(("steps", "refused_steps", "forced_steps"), COUNT),
                "least_opposed_sine": st.one_of(st.none(), st.floats(0, 1)),
                "largest_input_norm": SIZE,
                "largest_step": SIZE,
            },
            optional={"trace": st.fixed_dictionaries(trace)},
        )
    )


def frozen(lines):
    return tuple(map(tuple, lines))


def record_of(value):
    """The record that a file speaks of, put together by hand."""
    trace = value.get("trace")
    if trace is not None:
        tables = (frozen(trace[part]) for part in ("value", "bound", "limit"))
        trace = TraceRecord(tuple(trace["tau"]), *tables)
    requirements = tuple(RequirementRecord(**each) for each in value["requirements"])
    return GenerationRecord(**{**value, "requirements": requirements, "trace": trace})


@settings(deadline=None)
@given(generations())
def test_a_record_comes_back_as_it_was_written(value):
    """To the last bit, with its trace if it has one, and without a word of it if it has none."""
    made = record_of(value)
    assert parse_generation(read(value), "generation") == made
    assert read(made.to_json()) == value


@settings(deadline=None)
@given(st.one_of(st.none(), generations()), NUMBER, NUMBER, st.one_of(st.none(), TEXT))
def test_a_certificate_comes_back_as_it_was_written(value, margin, violation, reason):
    made = None if value is None else record_of(value)
    certificate = Certificate(reason is None, margin, violation, 3, reason, made)
    written = read(certificate.to_json())
    assert parse_certificate(written, "certificate") == certificate
    assert written.get("generation") == value
    assert ("generation" in written) == (value is not None)


TRACE = {
    "tau": [0.0, 0.5, 1.0],
    "value": [[1.0, -1.0], [0.5, -1.0], [0.0, -1.0]],
    "bound": [[1.0, 0.0], [0.6, 0.0], [0.0, 0.0]],
    "limit": [[1.0, 0.0], [0.7, 0.0], [0.2, 0.0]],
}
FIRST = {
    "name": "affordance",
    "value": 0.0,
    "limit": 0.2,
    "excess": -0.2,
    "active_points": 1,
    "smallest_ell_norm": 0.03,
}
MADE = {
    "hypotheses_hold": False,
    "first_failure": "laptop did not meet its row of balance at 2 points",
    "requirements": [FIRST, {**FIRST, "name": "balance", "smallest_ell_norm": None}],
    "steps": 2,
    "refused_steps": 1,
    "forced_steps": 0,
    "least_opposed_sine": 0.4,
    "largest_input_norm": 1.5,
    "largest_step": 1.5,
    "trace": TRACE,
}
GOOD = {
    "satisfied": True,
    "min_margin": 0.01,
    "violation": 0,
    "draws": 1,
    "reason": None,
    "generation": MADE,
}
ABSENT = object()


def edited(path, value):
    out = copy.deepcopy(GOOD)
    *parents, last = path
    place = out
    for key in parents:
        place = place[key]
    if value is ABSENT:
        del place[last]
    else:
        place[last] = value
    return out


def test_the_certificate_that_is_edited_is_good():
    found = parse_certificate(GOOD, "certificate")
    assert read(found.to_json()) == GOOD
    assert found.generation.requirements[1].name == "balance"
    assert found.generation.trace.limit[2] == (0.2, 0.0)


ROW = ("generation", "requirements", 1)
WIDE = "must hold 2 numbers at each of 3 values of tau"
# what is wrong: (where, what stands there instead, field, a word of the reason)
BAD = {
    "no generation at all": ((), None, "", "object"),
    "unknown key": (("by",), 1, "by", "unknown key"),
    "margin missing": (("min_margin",), ABSENT, "min_margin", "missing"),
    "margin not a number": (("min_margin",), math.nan, "min_margin", "lie in"),
    "violation beyond reason": (("violation",), 1e13, "violation", "lie in"),
    "too many draws": (("draws",), 10_001, "draws", "lie in"),
    "generation as text": (("generation",), "fine", "generation", "object"),
    "unknown key of the generation": (("generation", "by"), 1, "generation.by", "unknown key"),
    "hypotheses missing": (
        ("generation", "hypotheses_hold"),
        ABSENT,
        "generation.hypotheses_hold",
        "missing",
    ),
    "hypotheses as a number": (
        ("generation", "hypotheses_hold"),
        1,
        "generation.hypotheses_hold",
        "true or false",
    ),
    "failure as a flag": (
        ("generation", "first_failure"),
        True,
        "generation.first_failure",
        "text or null",
    ),
    "half a step": (("generation", "steps"), 1.5, "generation.steps", "integer"),
    "steps taken back": (("generation", "refused_steps"), -1, "generation.refused_steps", "lie in"),
    "forced as a flag": (
        ("generation", "forced_steps"),
        True,
        "generation.forced_steps",
        "integer",
    ),
    "sine above one": (
        ("generation", "least_opposed_sine"),
        1.01,
        "generation.least_opposed_sine",
        "[0, 1]",
    ),
    "sine as text": (
        ("generation", "least_opposed_sine"),
        "0",
        "generation.least_opposed_sine",
        "number",
    ),
    "input below zero": (
        ("generation", "largest_input_norm"),
        -1,
        "generation.largest_input_norm",
        "lie in",
    ),
    "input as null": (
        ("generation", "largest_input_norm"),
        None,
        "generation.largest_input_norm",
        "number",
    ),
    "requirements as an object": (
        ("generation", "requirements"),
        {},
        "generation.requirements",
        "list",
    ),
    "requirement as a list": (ROW, [1, 2], "generation.requirements[1]", "object"),
    "requirement without a limit": (
        (*ROW, "limit"),
        ABSENT,
        "generation.requirements[1].limit",
        "missing",
    ),
    "unknown key of a requirement": (
        (*ROW, "weight"),
        1,
        "generation.requirements[1].weight",
        "unknown key",
    ),
    "name as a number": ((*ROW, "name"), 2, "generation.requirements[1].name", "text"),
    "name as null": ((*ROW, "name"), None, "generation.requirements[1].name", "text"),
    "value as text": ((*ROW, "value"), "0", "generation.requirements[1].value", "number"),
    "infinite value": ((*ROW, "value"), math.inf, "generation.requirements[1].value", "lie in"),
    "excess as a flag": ((*ROW, "excess"), False, "generation.requirements[1].excess", "number"),
    "active at half a point": (
        (*ROW, "active_points"),
        0.5,
        "generation.requirements[1].active_points",
        "integer",
    ),
    "a length below zero": (
        (*ROW, "smallest_ell_norm"),
        -1e-9,
        "generation.requirements[1].smallest_ell_norm",
        "lie in",
    ),
    "trace as a list": (("generation", "trace"), [], "generation.trace", "object"),
    "trace without bounds": (
        ("generation", "trace", "bound"),
        ABSENT,
        "generation.trace.bound",
        "missing",
    ),
    "unknown key of the trace": (
        ("generation", "trace", "z"),
        [],
        "generation.trace.z",
        "unknown key",
    ),
    "tau as a number": (("generation", "trace", "tau"), 1.0, "generation.trace.tau", "list"),
    "tau as text": (("generation", "trace", "tau", 1), "0", "generation.trace.tau[1]", "number"),
    "a value of tau too few": (
        ("generation", "trace", "tau", 2),
        ABSENT,
        "generation.trace.value",
        "2 values of tau",
    ),
    "a point too few": (
        ("generation", "trace", "value", 2),
        ABSENT,
        "generation.trace.value",
        WIDE,
    ),
    "a point too many": (
        ("generation", "trace", "bound"),
        [*TRACE["bound"], [0, 0]],
        "generation.trace.bound",
        WIDE,
    ),
    "a row too few": (("generation", "trace", "limit", 1), [0.7], "generation.trace.limit", WIDE),
    "a row too many": (
        ("generation", "trace", "value", 0),
        [1, 2, 3],
        "generation.trace.value",
        WIDE,
    ),
    "a requirement too few": (ROW, ABSENT, "generation.trace.value", "must hold 1 numbers"),
    "a point as a number": (
        ("generation", "trace", "value", 1),
        0.5,
        "generation.trace.value[1]",
        "list",
    ),
    "a table as a number": (
        ("generation", "trace", "value"),
        0.5,
        "generation.trace.value",
        "list",
    ),
    "a table's entry as null": (
        ("generation", "trace", "limit", 2, 1),
        None,
        "generation.trace.limit[2][1]",
        "number",
    ),
    "a table's entry not a number": (
        ("generation", "trace", "limit", 2, 1),
        math.nan,
        "generation.trace.limit[2][1]",
        "lie in",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_named(what):
    path, value, field, word = BAD[what]
    with pytest.raises(InputError) as caught:
        parse_certificate(edited(path, value) if path else value, "certificate")
    assert caught.value.field == ".".join(filter(None, ("certificate", field)))
    assert word in caught.value.reason
    assert len(str(caught.value).splitlines()) == 1


# Records of earlier versions

NOW = {
    "held": "hypotheses_hold",
    "broken": "first_failure",
    "refused": "refused_steps",
    "forced": "forced_steps",
    "least_sine": "least_opposed_sine",
    "effort": "largest_input_norm",
}
NOW_OF_ROWS = {
    "active": "active_points",
    "smallest_ell": "smallest_ell_norm",
    "forced": "forced_steps",
    "kinks": "kink_points",
}


def with_old_names(record):
    before, before_of_rows = (
        {new: old for old, new in names.items()} for names in (NOW, NOW_OF_ROWS)
    )
    rows = [
        {before_of_rows.get(key, key): value for key, value in row.items()}
        for row in record["requirements"]
    ]
    return {before.get(key, key): value for key, value in {**record, "requirements": rows}.items()}


def refusal(value):
    with pytest.raises(InputError) as caught:
        parse_certificate(read(value), "certificate")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_record_of_an_earlier_version_is_refused_with_what_to_do():
    text = refusal({**GOOD, "generation": with_old_names(MADE)})
    assert text == (
        "field `certificate.generation`: the record has names of an older version "
        "(held, broken, refused, forced, least_sine, effort): rerun `generate`, or remove `generation` to certify "
        "without the record"
    )


@pytest.mark.parametrize("old", NOW)
def test_a_single_old_name_is_told(old):
    record = {**MADE, old: MADE[NOW[old]]}
    assert f"older version ({old})" in refusal({**GOOD, "generation": record})


@pytest.mark.parametrize("old", NOW_OF_ROWS)
def test_a_single_old_name_of_a_requirement_is_told(old):
    record = {**MADE, "requirements": [FIRST, {**FIRST, "name": "balance", old: 0}]}
    text = refusal({**GOOD, "generation": record})
    assert text.startswith(
        "field `certificate.generation.requirements[1]`: the record has names of an older version"
    )
    assert f"({old})" in text
