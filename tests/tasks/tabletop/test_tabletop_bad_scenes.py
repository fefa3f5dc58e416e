"""Scenes as JSON Lines: a good one comes back, and whatever is changed in it is named."""

import copy
import json

import pytest
from refused_lines import check, line

from deggflow.tasks.tabletop.condition import Balance
from deggflow.tasks.tabletop.formats import read_scenes

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
