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
        "active": COUNT,
        "smallest_ell": st.one_of(st.none(), SIZE),
    }
    requirements = st.lists(st.fixed_dictionaries(requirement), min_size=rows, max_size=rows)
    return draw(
        st.fixed_dictionaries(
            {
                "held": st.booleans(),
                "broken": st.one_of(st.none(), TEXT),
                "requirements": requirements,
                **dict.fromkeys(("steps", "refused", "forced"), COUNT),
                "least_sine": st.one_of(st.none(), st.floats(0, 1)),
                "effort": SIZE,
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
    "active": 1,
    "smallest_ell": 0.03,
}
MADE = {
    "held": False,
    "broken": "laptop did not meet its row of balance at 2 points",
    "requirements": [FIRST, {**FIRST, "name": "balance", "smallest_ell": None}],
    "steps": 2,
    "refused": 1,
    "forced": 0,
    "least_sine": 0.4,
    "effort": 1.5,
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
    "held missing": (("generation", "held"), ABSENT, "generation.held", "missing"),
    "held as a number": (("generation", "held"), 1, "generation.held", "true or false"),
    "broken as a flag": (("generation", "broken"), True, "generation.broken", "text or null"),
    "half a step": (("generation", "steps"), 1.5, "generation.steps", "integer"),
    "steps taken back": (("generation", "refused"), -1, "generation.refused", "lie in"),
    "forced as a flag": (("generation", "forced"), True, "generation.forced", "integer"),
    "sine above one": (("generation", "least_sine"), 1.01, "generation.least_sine", "[0, 1]"),
    "sine as text": (("generation", "least_sine"), "0", "generation.least_sine", "number"),
    "effort below zero": (("generation", "effort"), -1, "generation.effort", "lie in"),
    "effort as null": (("generation", "effort"), None, "generation.effort", "number"),
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
        (*ROW, "active"),
        0.5,
        "generation.requirements[1].active",
        "integer",
    ),
    "a length below zero": (
        (*ROW, "smallest_ell"),
        -1e-9,
        "generation.requirements[1].smallest_ell",
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
