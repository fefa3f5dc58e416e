"""JSON values as annotated dataclasses, checked against what each annotation means."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deggflow.jsonl import InputError
from deggflow.schema import parse_as


@dataclass(frozen=True)
class Part:
    name: str
    rate: float


@dataclass(frozen=True)
class Whole:
    count: int
    rate: float | None
    right: bool
    names: Sequence[str]
    pair: tuple[float, int]
    many: tuple[Part, ...]
    parts: Mapping[str, Part]
    rest: dict[str, Any]


finite = st.floats(-1e300, 1e300)
parts = st.builds(Part, st.text(), finite)
wholes = st.builds(
    Whole,
    st.integers(-(2**63) + 1, 2**63 - 1),
    st.none() | finite,
    st.booleans(),
    st.lists(st.text()),
    st.tuples(finite, st.integers(0, 9)),
    st.lists(parts).map(tuple),
    st.dictionaries(st.text(), parts),
    st.dictionaries(st.text(), st.none() | st.integers() | st.lists(st.text())),
)


@given(wholes)
def test_what_was_written_is_read_back(whole):
    assert parse_as(Whole, json.loads(json.dumps(asdict(whole)))) == whole


GOOD = {
    "count": 1,
    "rate": 1,
    "right": True,
    "names": [],
    "pair": [0.5, 2],
    "many": [{"name": "", "rate": 1}],
    "parts": {"one": {"name": "", "rate": 1}},
    "rest": {},
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 1.0}, "field `count`: must be an integer; got 1.0"),
        ({"count": True}, "field `count`: must be an integer; got true"),
        ({"count": 10**40}, "field `count`: must lie in"),
        ({"rate": "1"}, 'field `rate`: must be a number; got "1"'),
        ({"rate": float("inf")}, "field `rate`: must lie in"),
        ({"right": 1}, "field `right`: must be true or false; got 1"),
        ({"names": "ab"}, 'field `names`: must be a list; got "ab"'),
        ({"names": ["a", 1]}, "field `names[1]`: must be text; got 1"),
        ({"pair": [1.0]}, "field `pair`: must hold 2 values; got 1"),
        ({"many": [{"name": "a"}]}, "field `many[0].rate`: is missing"),
        ({"parts": {"one": []}}, "field `parts.one`: must be a JSON object; got []"),
        ({"rest": None}, "field `rest`: must be a JSON object; got null"),
        ({"more": 1}, "field `more`: unknown key"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(InputError, match=re.escape(message)):
        parse_as(Whole, {**GOOD, **change})


def test_what_is_missing_is_named():
    for name in GOOD:
        with pytest.raises(InputError, match=f"field `{name}`: is missing"):
            parse_as(Whole, {key: value for key, value in GOOD.items() if key != name})
