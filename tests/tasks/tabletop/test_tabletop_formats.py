"""Conditions and scenes as JSON Lines: what is valid comes back as it was, what is not is named."""

import copy
import json
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.certificate import Certificate
from deggflow.jsonl import MAX_LINE, InputError, parse_line
from deggflow.tasks.tabletop.condition import Affordance, Balance, SceneCondition
from deggflow.tasks.tabletop.formats import (
    parse_condition,
    parse_scene,
    read_conditions,
    read_scenes,
)
from deggflow.tasks.tabletop.library import NAMES
from deggflow.tasks.tabletop.scene import Scene

SCALE = st.one_of(st.floats(0.01, 10.0), st.integers(1, 10))
ANGLE = st.one_of(st.floats(-2 * math.pi, 2 * math.pi), st.integers(-6, 6))
LENGTH = st.one_of(st.floats(0.01, 100.0), st.integers(1, 100))
NEED = st.fixed_dictionaries(
    {}, optional={"offset_scale": SCALE, "radius_scale": SCALE, "direction": ANGLE}
)
PLACE = st.one_of(st.floats(-100.0, 100.0), st.integers(-100, 100))
RADIUS = st.one_of(st.floats(1e-3, 100.0), st.integers(1, 100))
CIRCLE = st.fixed_dictionaries({}, optional={"x": PLACE, "y": PLACE, "radius": RADIUS})
POSE = st.tuples(*[st.floats(-1e6, 1e6)] * 3)


@st.composite
def conditions(draw):
    """Condition objects as a user may write them, every optional part present or absent."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=12, unique=True))
    needs = st.dictionaries(st.sampled_from(names), NEED)
    table = st.fixed_dictionaries({"width": LENGTH, "depth": LENGTH})
    parts = {"requirements": needs, "table": table, "balance": CIRCLE}
    return {"objects": names, **draw(st.fixed_dictionaries({}, optional=parts))}


@st.composite
def scenes(draw):
    """Condition objects, and what a scene has beside its condition."""
    condition = draw(conditions())
    poses = draw(st.tuples(*[POSE] * len(condition["objects"])))
    reason = draw(st.one_of(st.none(), st.text(max_size=20)))
    margin, violation = draw(st.floats(-1e6, 1e6)), draw(st.floats(0, 1e9))
    said = (reason is None, margin, violation, draw(st.integers(1, 100)), reason)
    return condition, poses, said, draw(st.integers(0, 2**31 - 1))


def line(value):
    return json.dumps(value, allow_nan=False).encode()


@settings(deadline=None)
@given(conditions())
def test_a_condition_comes_back_as_it_was_given(value):
    condition = parse_condition(parse_line(line(value)))
    assert condition.to_json() == value
    assert condition.objects == tuple(value["objects"])
    for name in value["objects"]:
        need = value.get("requirements", {}).get(name, {})
        assert condition.affordance(name) == Affordance(**{key: float(need[key]) for key in need})
    if "table" in value:
        assert {"width": condition.width, "depth": condition.depth} == value["table"]
    else:
        assert (condition.width, condition.depth) == (1.40, 0.94)
    if "balance" in value:
        circle = {"x": 0.0, "y": 0.0, "radius": 0.05, **value["balance"]}
        assert condition.balance == Balance(*(float(circle[key]) for key in ("x", "y", "radius")))
    else:
        assert condition.balance is None


@settings(deadline=None)
@given(conditions())
def test_a_condition_made_in_python_comes_back_equal(value):
    """Without the object it was read from, what is written says the same."""
    read = parse_condition(value)
    made = SceneCondition(read.objects, read.requirements, read.width, read.depth, read.balance)
    assert parse_condition(parse_line(line(made.to_json()))) == made == read


@settings(deadline=None)
@given(scenes())
def test_a_scene_comes_back_as_it_was_written(drawn):
    """To the last bit."""
    condition, poses, said, seed = drawn
    scene = Scene(parse_condition(condition), np.array(poses), Certificate(*said), seed)
    again = parse_scene(parse_line(line(scene.to_json())))
    assert again.to_json() == scene.to_json()
    assert again.condition == scene.condition
    assert again.certificate == scene.certificate
    np.testing.assert_array_equal(again.poses, scene.poses)


def test_files_are_read_line_by_line(tmp_path):
    """In order; with or without the last line's end, and with another system's line ends."""
    values = [{"objects": [name]} for name in NAMES]
    for end, last in ((b"\n", b"\n"), (b"\n", b""), (b"\r\n", b"\r\n")):
        path = tmp_path / "conditions.jsonl"
        path.write_bytes(end.join(line(value) for value in values) + last)
        assert [c.objects for c in read_conditions(path)] == [(name,) for name in NAMES]


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


def refusal(read, path):
    """The message of the error that reading a file raises; it is one line of printable text."""
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.isprintable()
    message.encode()
    assert str(path) in message
    return message


def check(read, path, content, number, field, word):
    path.write_bytes(content)
    message = refusal(read, path)
    place, reason = message.removeprefix(str(path)).split(": ", 1)
    assert place == f", line {number}" + (f", field `{field}`" if field else "")
    assert word in reason
    assert len(message) < 600  # a quotation of what was wrong, not all of it


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


SCENE = {
    "condition": {"objects": ["laptop", "teacup"], "requirements": {"teacup": {"direction": 1.5}}},
    "objects": [
        {"name": "laptop", "x": 0.1, "y": 0.2, "theta": 3},
        {"name": "teacup", "x": -0.1, "y": 0.0, "theta": -7.5},
    ],
    "certificate": {
        "satisfied": True,
        "min_margin": 0.01,
        "violation": 0.0,
        "draws": 1,
        "reason": None,
    },
    "seed": 3,
}
ABSENT = object()
MADE = {
    "hypotheses_hold": True,
    "first_failure": None,
    "requirements": [
        {
            "name": "affordance",
            "value": 0.0,
            "limit": 0.0002,
            "excess": -0.0001,
            "active_points": 5,
            "smallest_ell_norm": 0.01,
        }
    ],
    "steps": 100,
    "refused_steps": 0,
    "forced_steps": 0,
    "least_opposed_sine": None,
    "largest_input_norm": 1.5,
    "largest_step": 1.5,
}
GENERATION = ("certificate", "generation")

# what is wrong: (path to the value, what stands there instead, field, a word of the reason)
BAD_SCENES = {
    "unknown key": (("note",), "", "note", "unknown"),
    "missing condition": (("condition",), ABSENT, "condition", "missing"),
    "missing objects": (("objects",), ABSENT, "objects", "missing"),
    "missing certificate": (("certificate",), ABSENT, "certificate", "missing"),
    "missing seed": (("seed",), ABSENT, "seed", "missing"),
    "condition of unknown objects": (
        ("condition", "objects", 0),
        "spoon",
        "condition.objects[0]",
        "unknown",
    ),
    "condition with an unknown key": (("condition", "colour"), 1, "condition.colour", "unknown"),
    "requirement out of range": (
        ("condition", "requirements", "teacup", "direction"),
        90,
        "condition.requirements.teacup.direction",
        "rad",
    ),
    "one pose too few": (("objects", 1), ABSENT, "objects", "one pose each"),
    "poses as an object": (("objects",), {}, "objects", "one pose each"),
    "pose as a list": (("objects", 1), [0, 0, 0], "objects[1]", "object"),
    "other order": (("objects", 0, "name"), "teacup", "objects[0].name", "laptop"),
    "unknown key of a pose": (("objects", 0, "z"), 0.0, "objects[0].z", "unknown"),
    "missing heading": (("objects", 1, "theta"), ABSENT, "objects[1].theta", "missing"),
    "position as text": (("objects", 1, "x"), "0.1", "objects[1].x", "number"),
    "position as bool": (("objects", 1, "y"), True, "objects[1].y", "number"),
    "position beyond reason": (("objects", 0, "x"), 1e300, "objects[0].x", "lie in"),
    "satisfied as a number": (
        ("certificate", "satisfied"),
        1,
        "certificate.satisfied",
        "true or false",
    ),
    "margin as null": (("certificate", "min_margin"), None, "certificate.min_margin", "number"),
    "draws as a float": (("certificate", "draws"), 1.5, "certificate.draws", "integer"),
    "draws as bool": (("certificate", "draws"), True, "certificate.draws", "integer"),
    "reason as a number": (("certificate", "reason"), 3, "certificate.reason", "text"),
    "unknown key of the certificate": (("certificate", "by"), "", "certificate.by", "unknown"),
    "missing key of the certificate": (
        ("certificate", "draws"),
        ABSENT,
        "certificate.draws",
        "missing",
    ),
    "generation as a list": (GENERATION, [], "certificate.generation", "object"),
    "generation without steps": (
        GENERATION,
        {key: value for key, value in MADE.items() if key != "steps"},
        "certificate.generation.steps",
        "missing",
    ),
    "requirement without a number": (
        GENERATION,
        MADE | {"requirements": [MADE["requirements"][0] | {"value": "low"}]},
        "certificate.generation.requirements[0].value",
        "number",
    ),
    "circle of a scene": (
        ("condition", "balance"),
        {"radius": 0},
        "condition.balance.radius",
        "lie in",
    ),
    "no draws": (("certificate", "draws"), 0, "certificate.draws", "lie in"),
    "negative seed": (("seed",), -1, "seed", "lie in"),
    "seed that no generator takes": (("seed",), 2**31, "seed", "lie in"),
    "seed as bool": (("seed",), False, "seed", "integer"),
    "seed as text": (("seed",), "3", "seed", "integer"),
}


def edited(path, value):
    scene = copy.deepcopy(SCENE)
    *parents, last = path
    place = scene
    for key in parents:
        place = place[key]
    if value is ABSENT:
        del place[last]
    else:
        place[last] = value
    return scene


@pytest.mark.parametrize("what", BAD_SCENES)
def test_a_bad_scene_is_refused(tmp_path, what):
    """On the line where it stands, after a good one."""
    path, value, field, word = BAD_SCENES[what]
    content = line(SCENE) + b"\n" + line(edited(path, value)) + b"\n"
    check(read_scenes, tmp_path / "scenes.jsonl", content, 2, field, word)


def test_the_scene_that_is_edited_is_good(tmp_path):
    path = tmp_path / "scenes.jsonl"
    path.write_bytes(line(SCENE) + b"\n")
    assert [scene.to_json() for scene in read_scenes(path)] == [SCENE]


def test_a_scene_comes_back_with_what_is_said_of_its_generation(tmp_path):
    """And with the circle that its objects share."""
    value = edited(("condition", "balance"), {"y": 0.1, "radius": 0.2})
    value["certificate"]["generation"] = MADE
    path = tmp_path / "scenes.jsonl"
    path.write_bytes(line(value) + b"\n" + line(SCENE) + b"\n")
    shared, other = read_scenes(path)
    assert json.loads(line(shared.to_json())) == value
    assert shared.condition.balance == Balance(0.0, 0.1, 0.2)
    assert shared.certificate.generation.requirements[0].name == "affordance"
    assert (other.condition.balance, other.certificate.generation) == (None, None)
