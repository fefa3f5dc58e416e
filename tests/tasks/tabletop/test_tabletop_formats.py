"""Conditions and scenes as JSON Lines: what is valid comes back as it was."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from refused_lines import line

from deggflow.certificate import Certificate
from deggflow.jsonl import parse_line
from deggflow.tasks.tabletop.condition import Affordance, Balance, SceneCondition
from deggflow.tasks.tabletop.formats import parse_condition, parse_scene, read_conditions
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
