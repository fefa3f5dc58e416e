"""Conditions as JSON Lines: what is not valid is refused with its line, its field and the reason."""

import sys

import pytest
from refused_lines import check, line, refusal

from deggflow.jsonl import MAX_LINE, InputError, parse_line
from deggflow.tasks.tabletop.formats import parse_condition, read_conditions, read_scenes
from deggflow.tasks.tabletop.library import NAMES

GOOD = b'{"objects": ["laptop", "teacup"]}\n'


def requirement(text):
    return b'{"objects": ["laptop"], "requirements": {"laptop": {' + text + b"}}}\n"


def table(text):
    return b'{"objects": ["laptop"], "table": ' + text + b"}\n"


def balance(text):
    return b'{"objects": ["laptop"], "balance": ' + text + b"}\n"


OFFSET = "requirements.laptop.offset_scale"
# what is wrong: (content, line, field or None, a word of the reason)
BAD_CONDITIONS = {
    "truncated JSON": (b'{"objects": ["laptop", "tea', 1, None, "not JSON"),
    "truncated third line": (GOOD + GOOD + b'{"objects"', 3, None, "not JSON"),
    "two values on a line": (GOOD[:-1] + GOOD, 1, None, "not JSON"),
    "comment": (b"// two objects\n" + GOOD, 1, None, "not JSON"),
    "single quotes": (b"{'objects': ['laptop']}\n", 1, None, "not JSON"),
    "unknown object": (b'{"objects": ["laptop", "spoon"]}\n', 1, "objects[1]", "spoon"),
    "wrong case": (b'{"objects": ["Laptop"]}\n', 1, "objects[0]", "Laptop"),
    "duplicate object": (
        b'{"objects": ["laptop", "teacup", "laptop"]}\n',
        1,
        "objects[2]",
        "twice",
    ),
    "object that is a number": (b'{"objects": ["laptop", 7]}\n', 1, "objects[1]", "name"),
    "object that is a list": (b'{"objects": [["laptop"]]}\n', 1, "objects[0]", "name"),
    "a thirteenth object": (
        line({"objects": [*NAMES, "laptop"]}) + b"\n",
        1,
        "objects[12]",
        "laptop#2",
    ),
    "too many objects": (line({"objects": ["laptop"] * 10_001}) + b"\n", 1, "objects", "10001"),
    "a first object with a number": (b'{"objects": ["laptop#1"]}\n', 1, "objects[0]", "laptop#1"),
    "a number with a zero before it": (b'{"objects": ["laptop#02"]}\n', 1, "objects[0]", "unknown"),
    "wish of a numbered object that is not there": (
        b'{"objects": ["laptop"], "requirements": {"laptop#2": {}}}\n',
        1,
        "requirements.laptop#2",
        "not among",
    ),
    "no objects": (b'{"objects": []}\n', 1, "objects", "1 to 10000"),
    "objects as text": (b'{"objects": "laptop"}\n', 1, "objects", "list"),
    "objects as null": (b'{"objects": null}\n', 1, "objects", "list"),
    "missing objects": (b'{"table": {"width": 1, "depth": 1}}\n', 1, "objects", "missing"),
    "a list": (b'["laptop"]\n', 1, None, "object"),
    "a number": (b"3\n", 1, None, "object"),
    "null": (b"null\n", 1, None, "object"),
    "duplicate key": (b'{"objects": ["laptop"], "objects": ["teacup"]}\n', 1, "objects", "twice"),
    "duplicate key inside": (
        requirement(b'"direction": 1, "direction": 2'),
        1,
        "direction",
        "twice",
    ),
    "unknown key": (b'{"objects": ["laptop"], "colour": "red"}\n', 1, "colour", "unknown"),
    "unknown key of a requirement": (
        requirement(b'"scale": 1'),
        1,
        "requirements.laptop.scale",
        "unknown",
    ),
    "unknown key of the table": (
        table(b'{"width": 1, "depth": 1, "height": 1}'),
        1,
        "table.height",
        "unknown",
    ),
    "unknown object in requirements": (
        b'{"objects": ["laptop"], "requirements": {"spoon": {}}}\n',
        1,
        "requirements.spoon",
        "unknown",
    ),
    "requirement for an object not in the scene": (
        b'{"objects": ["laptop"], "requirements": {"teacup": {"direction": 1}}}\n',
        1,
        "requirements.teacup",
        "not among the objects",
    ),
    "requirements as a list": (
        b'{"objects": ["laptop"], "requirements": []}\n',
        1,
        "requirements",
        "object",
    ),
    "requirement as a number": (
        b'{"objects": ["laptop"], "requirements": {"laptop": 2}}\n',
        1,
        "requirements.laptop",
        "object",
    ),
    "NaN": (requirement(b'"offset_scale": NaN'), 1, None, "NaN"),
    "Infinity": (requirement(b'"offset_scale": Infinity'), 1, None, "Infinity"),
    "-Infinity": (requirement(b'"direction": -Infinity'), 1, None, "-Infinity"),
    "1e999": (requirement(b'"offset_scale": 1e999'), 1, OFFSET, "lie in"),
    "huge integer": (requirement(b'"offset_scale": 1' + b"0" * 400), 1, OFFSET, "lie in"),
    "integer past all conversion": (
        requirement(b'"offset_scale": 1' + b"0" * 5000),
        1,
        None,
        "digits",
    ),
    "negative scale": (requirement(b'"offset_scale": -1'), 1, OFFSET, "lie in"),
    "zero scale": (
        requirement(b'"radius_scale": 0'),
        1,
        "requirements.laptop.radius_scale",
        "lie in",
    ),
    "scale as text": (requirement(b'"offset_scale": "1"'), 1, OFFSET, "number"),
    "scale as null": (requirement(b'"offset_scale": null'), 1, OFFSET, "number"),
    "bool as number": (requirement(b'"offset_scale": true'), 1, OFFSET, "number"),
    "direction in degrees": (
        requirement(b'"direction": 90'),
        1,
        "requirements.laptop.direction",
        "rad",
    ),
    "negative table": (table(b'{"width": -1.4, "depth": 0.94}'), 1, "table.width", "lie in"),
    "no table at all": (table(b'{"width": 0, "depth": 0.94}'), 1, "table.width", "lie in"),
    "missing table key": (table(b'{"width": 1.4}'), 1, "table.depth", "missing"),
    "table as a list": (table(b"[1.4, 0.94]"), 1, "table", "object"),
    "circle of radius zero": (balance(b'{"radius": 0}'), 1, "balance.radius", "[0.001, 100] m"),
    "circle turned inside out": (balance(b'{"radius": -0.1}'), 1, "balance.radius", "lie in"),
    "circle without an end": (balance(b'{"radius": 1e999}'), 1, "balance.radius", "lie in"),
    "circle that is not a number": (balance(b'{"x": NaN}'), 1, None, "NaN"),
    "circle far out": (balance(b'{"x": 0, "y": -101}'), 1, "balance.y", "[-100, 100] m"),
    "radius as text": (balance(b'{"radius": "0.1"}'), 1, "balance.radius", "number"),
    "radius as null": (balance(b'{"radius": null}'), 1, "balance.radius", "number"),
    "radius as bool": (balance(b'{"radius": true}'), 1, "balance.radius", "number"),
    "unknown key of the balance": (balance(b'{"mass": 1}'), 1, "balance.mass", "unknown"),
    "balance as a list": (balance(b"[0, 0, 0.1]"), 1, "balance", "object"),
    "balance as bool": (balance(b"true"), 1, "balance", "object"),
    "balance as null": (balance(b"null"), 1, "balance", "object"),
    "balance twice": (balance(b'{"radius": 1, "radius": 2}'), 1, "radius", "twice"),
    "table size as bool": (table(b'{"width": true, "depth": 0.94}'), 1, "table.width", "number"),
    "empty file": (b"", 1, None, "empty"),
    "empty line in the middle": (GOOD + b"\n" + GOOD, 2, None, "empty"),
    "blank line at the end": (GOOD + b"  \n", 2, None, "empty"),
    "huge line": (b'{"objects": ["laptop"' + b" " * MAX_LINE + b"]}\n", 1, None, "longer"),
    "huge line without an end": (GOOD + b"[" * (4 * MAX_LINE), 2, None, "longer"),
    "deeply nested": (b'{"objects": ' + b"[" * 20000 + b"]" * 20000 + b"}\n", 1, None, "nested"),
    "binary": (bytes(range(256)) * 4, 1, None, ""),
    "not UTF-8": (b'{"objects": ["caf\xe9"]}\n', 1, None, "UTF-8"),
    "UTF-16": (GOOD.decode().encode("utf-16"), 1, None, "UTF-8"),
    "null bytes": (b"\0" * 100 + b"\n", 1, None, "not JSON"),
    "a key that breaks lines": (
        b'{"objects": ["laptop"], "a\\nb\\u2028c": 1}\n',
        1,
        "a\\nb\\u2028c",
        "unknown",
    ),
    "half a surrogate pair": (b'{"objects": ["\\ud800"]}\n', 1, "objects[0]", "unknown"),
}


@pytest.mark.parametrize("what", BAD_CONDITIONS)
def test_a_bad_condition_is_refused(tmp_path, what):
    check(read_conditions, tmp_path / "conditions.jsonl", *BAD_CONDITIONS[what])


@pytest.mark.parametrize("read", [read_conditions, read_scenes])
def test_what_is_no_readable_file(tmp_path, read):
    assert "No such file" in refusal(read, tmp_path / "missing.jsonl")
    assert "directory" in refusal(read, tmp_path)
    assert "directory" in refusal(read, tmp_path / "missing" / "conditions.jsonl")


def test_any_depth_of_nesting_is_refused(tmp_path):
    """The parser's own limit lies somewhere; no depth near it goes unnoticed, or through."""
    limit = sys.getrecursionlimit()
    for depth in (*range(limit // 2, limit + 10), 3 * limit):
        for text in (b"[" * depth + b"]" * depth, b'{"objects": ' * depth + b"1" + b"}" * depth):
            with pytest.raises(InputError):
                parse_condition(
                    parse_line(b'{"objects": ["laptop"], "requirements": ' + text + b"}")
                )
