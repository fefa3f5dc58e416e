"""Bridge conditions and trials as JSON Lines: what is valid comes back as it was, what is not is named."""

import copy
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.jsonl import InputError, parse_line
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.formats import (
    parse_condition,
    parse_trial,
    read_conditions,
    read_trials,
)

CONDITION = {
    "plank": {"x": -3.2, "y": 0.5, "theta": 0.1},
    "goal": {"x": -0.2, "y": 0, "theta": 0},
    "contacts": [[-2.4, 0.36], [-2.4, -0.36], [1.0, 0.36]],
}
POLICY = {
    "q_task": -0.5,
    "bound": -0.4,
    "q_safe": -1.5,
    "draws": 2,
    "accepted": True,
    "speed": 0.31,
}
REQUIREMENT = {
    "name": "q_task",
    "value": -0.5,
    "limit": -0.4,
    "excess": -0.01,
    "active_points": 40,
    "smallest_ell_norm": 0.02,
}
MADE = {
    "hypotheses_hold": False,
    "first_failure": "robot 2 did not meet its row of q_safe at 3 points",
    "requirements": [REQUIREMENT, {**REQUIREMENT, "name": "q_safe", "smallest_ell_norm": None}],
    "steps": 51,
    "refused_steps": 2,
    "forced_steps": 0,
    "least_opposed_sine": 0.125,
    "largest_input_norm": 3.5,
    "largest_step": 3.5,
}
TRIAL = {
    "condition": CONDITION,
    "dt": 0.2,
    "twists": [[0.1, 0.0, -0.2], [0.2, 0, 0]],
    "poses": [[-3.2, 0.5, 0.1], [-3.18, 0.5, 0.06], [-3.14, 0.5, 0.06]],
    "outcome": {"success": False, "reason": "robot 1 enters the gap"},
    "certificate": {
        "satisfied": False,
        "min_margin": -0.01,
        "violation": 0,
        "draws": 2,
        "reason": "robot 1 enters the gap",
        "policies": [POLICY],
    },
    "seed": 7,
}


def line(value):
    return json.dumps(value).encode()  # NaN and Infinity as Python writes them


def edited(value, path, new):
    """A copy with one entry replaced or added; `...` removes it."""
    out = copy.deepcopy(value)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    if new is ...:
        del place[last]
    else:
        place[last] = new
    return out


NUMBER = st.one_of(st.floats(-3.0, 3.0), st.integers(-3, 3))
POSE = st.fixed_dictionaries({"x": NUMBER, "y": NUMBER, "theta": NUMBER})
TEXT = st.text(min_size=1, max_size=20)


@st.composite
def condition_objects(draw):
    """Two to eight robots, apart from each other on both edges."""
    count = draw(st.integers(2, 8))
    places = draw(st.permutations([(0.33 * k - 2.9, s) for k in range(18) for s in (0.36, -0.36)]))
    shift = draw(st.floats(0.0, 0.1))
    contacts = [[x + shift, side] for x, side in places[:count]]
    return {"plank": draw(POSE), "goal": draw(POSE), "contacts": contacts}


@st.composite
def trial_objects(draw):
    condition, success = draw(condition_objects()), draw(st.booleans())
    twists = draw(st.lists(st.tuples(*[st.floats(-100, 100)] * 3).map(list), max_size=5))
    start = [float(condition["plank"][key]) for key in ("x", "y", "theta")]
    after = [draw(st.tuples(*[st.floats(-1e6, 1e6)] * 3).map(list)) for _ in twists]
    value = st.floats(-1e6, 1e6)
    policy = st.fixed_dictionaries(
        {
            **dict.fromkeys(("q_task", "bound", "q_safe"), value),
            "draws": st.integers(1, 100),
            "accepted": st.booleans(),
            "speed": st.floats(0, 1e6),
        },
        optional={"generation": st.just(MADE)},
    )
    limit = st.fixed_dictionaries({}, optional={"speed_limit": st.floats(0.01, 10.0)})
    certificate = {
        "satisfied": success,
        "min_margin": draw(value),
        "violation": draw(st.floats(0, 1e9)),
        "draws": draw(st.integers(1, 100)),
        "reason": draw(st.one_of(st.none(), TEXT)),
        "policies": draw(st.lists(policy, max_size=3)),
        **draw(limit),
    }
    return {
        "condition": condition,
        "dt": 0.2,
        "twists": twists,
        "poses": [start, *after],
        "outcome": {"success": success, "reason": None if success else draw(TEXT)},
        "certificate": certificate,
        "seed": draw(st.integers(0, 2**31 - 1)),
    }


@settings(deadline=None)
@given(condition_objects())
def test_a_condition_comes_back_as_it_was_given(value):
    condition = parse_condition(parse_line(line(value)))
    assert condition.to_json() == value
    assert condition.plank == tuple(value["plank"][key] for key in ("x", "y", "theta"))
    assert condition.contacts == tuple(map(tuple, value["contacts"]))
    made = TrialCondition(condition.plank, condition.goal, condition.contacts)
    assert parse_condition(parse_line(line(made.to_json()))) == made == condition


@settings(deadline=None)
@given(trial_objects())
def test_a_trial_comes_back_as_it_was_written(value):
    """To the last bit."""
    trial = parse_trial(parse_line(line(value)))
    assert json.loads(line(trial.to_json())) == value
    again = parse_trial(parse_line(line(trial.to_json())))
    assert again.certificate == trial.certificate
    np.testing.assert_array_equal(again.poses, trial.poses)


def test_what_was_written_before_there_were_speeds_is_still_read():
    value = edited(TRIAL, ["certificate", "policies", 0, "speed"], ...)
    certificate = parse_trial(parse_line(line(value))).certificate
    assert certificate.speed_limit is None
    assert certificate.policies[0].generation is None
    assert certificate.policies[0].q_safe == POLICY["q_safe"]


def test_robots_that_touch_do_not_overlap():
    """0.32 m in decimals is enough, though not in binary numbers; opposite edges are always far enough apart."""
    for x, side in ((0.1 + 0.32, 0.36), (0.42, 0.36), (0.1, -0.36), (0.1, -0.3600001)):
        parse_condition({**CONDITION, "contacts": [[0.1, 0.36], [x, side]]})
    with pytest.raises(InputError, match="robots 1 and 2 overlap"):
        parse_condition({**CONDITION, "contacts": [[0.1, 0.36], [0.419, 0.36]]})


def test_a_start_that_is_broken_is_a_valid_condition():
    """What comes of it is said in the trial."""
    value = edited(CONDITION, ["plank"], {"x": 0.9, "y": 2.99, "theta": -math.pi})
    assert parse_condition(value).plank == (0.9, 2.99, -math.pi)


# what is wrong: (where, what stands there instead, field, a word of the reason)
BAD_CONDITIONS = {
    "unknown key": (["colour"], 1, "colour", "unknown key"),
    "missing key": (["goal"], ..., "goal", "missing"),
    "unknown key of a pose": (["plank", "z"], 0, "plank.z", "unknown key"),
    "missing key of a pose": (["plank", "theta"], ..., "plank.theta", "missing"),
    "pose as a list": (["goal"], [0, 0, 0], "goal", "object"),
    "text for a number": (["plank", "x"], "1", "plank.x", "number"),
    "true for a number": (["plank", "x"], True, "plank.x", "number"),
    "null for a number": (["goal", "y"], None, "goal.y", "number"),
    "NaN": (["goal", "y"], math.nan, "", "NaN"),
    "infinite": (["goal", "y"], -math.inf, "", "Infinity"),
    "far out": (["plank", "x"], -7.1, "plank.x", "[-7, 6.8]"),
    "far aside": (["goal", "y"], 3.01, "goal.y", "[-3, 3]"),
    "more than a turn": (["plank", "theta"], 6.3, "plank.theta", "rad"),
    "contacts as text": (["contacts"], "all", "contacts", "2 to 8"),
    "no robot": (["contacts"], [], "contacts", "2 to 8"),
    "one robot": (["contacts"], [[0, 0.36]], "contacts", "2 to 8"),
    "nine robots": (
        ["contacts"],
        [[0.4 * k - 2, 0.36] for k in range(9)],
        "contacts",
        "2 to 8",
    ),
    "contact with one number": (["contacts", 1], [0.5], "contacts[1]", "[r_x, r_y]"),
    "contact as an object": (["contacts", 0], {"x": 0, "y": 0}, "contacts[0]", "[r_x, r_y]"),
    "contact beyond the end": (["contacts", 2], [2.91, 0.36], "contacts[2][0]", "[-2.9, 2.9]"),
    "contact off the edge": (["contacts", 2], [0.5, 0.35], "contacts[2][1]", "long edge"),
    "contact inside": (["contacts", 2], [0.5, 0], "contacts[2][1]", "long edge"),
    "contact as text": (["contacts", 2], ["0", 0.36], "contacts[2][0]", "number"),
    "overlapping robots": (["contacts", 2], [-2.1, 0.36], "contacts[2]", "robots 1 and 3 overlap"),
}
BAD_TRIALS = {
    "unknown key": (["note"], "", "note", "unknown key"),
    "missing key": (["seed"], ..., "seed", "missing"),
    "bad condition": (["condition", "plank", "x"], 99, "condition.plank.x", "[-7, 6.8]"),
    "other dt": (["dt"], 0.1, "dt", "must be 0.2"),
    "dt as text": (["dt"], "0.2", "dt", "must be 0.2"),
    "twists as an object": (["twists"], {}, "twists", "list"),
    "twist of two": (["twists", 1], [0, 0], "twists[1]", "[v_x, v_y, omega]"),
    "twist as text": (["twists", 0, 2], "fast", "twists[0][2]", "number"),
    "far too fast": (["twists", 0, 0], 101.0, "twists[0][0]", "[-100, 100]"),
    "NaN": (["twists", 0, 0], math.nan, "", "NaN"),
    "a pose too few": (["poses", 2], ..., "poses", "one pose more"),
    "a twist too few": (
        ["twists", 1],
        ...,
        "poses",
        "one pose more than there are twists, 2; got 3",
    ),
    "no pose": (["poses"], [], "poses", "one pose more"),
    "pose of two": (["poses", 2], [0, 0], "poses[2]", "[x, y, theta]"),
    "pose out of the world": (["poses", 2, 1], 1e7, "poses[2][1]", "must lie in"),
    "another first pose": (["poses", 0], [-3.2, 0.5, 0.2], "poses[0]", "the condition's plank"),
    "outcome as text": (["outcome"], "ok", "outcome", "object"),
    "unknown key of the outcome": (["outcome", "why"], "", "outcome.why", "unknown key"),
    "success as a number": (["outcome", "success"], 1, "outcome.success", "true or false"),
    "success with a reason": (["outcome", "success"], True, "outcome.reason", "null"),
    "failure without a reason": (["outcome", "reason"], None, "outcome.reason", "why"),
    "failure with no word": (["outcome", "reason"], "", "outcome.reason", "why"),
    "reason as a number": (["outcome", "reason"], 3, "outcome.reason", "text"),
    "certificate as null": (["certificate"], None, "certificate", "object"),
    "missing key of the certificate": (
        ["certificate", "policies"],
        ...,
        "certificate.policies",
        "missing",
    ),
    "satisfied as text": (
        ["certificate", "satisfied"],
        "yes",
        "certificate.satisfied",
        "true or false",
    ),
    "negative violation": (["certificate", "violation"], -1, "certificate.violation", "[0"),
    "no draws": (["certificate", "draws"], 0, "certificate.draws", "[1"),
    "half a draw": (["certificate", "draws"], 1.5, "certificate.draws", "integer"),
    "margin as a list": (["certificate", "min_margin"], [], "certificate.min_margin", "number"),
    "policies as an object": (["certificate", "policies"], {}, "certificate.policies", "list"),
    "policy as a list": (["certificate", "policies", 0], [], "certificate.policies[0]", "object"),
    "policy without q_safe": (
        ["certificate", "policies", 0, "q_safe"],
        ...,
        "certificate.policies[0].q_safe",
        "missing",
    ),
    "policy with an unknown key": (
        ["certificate", "policies", 0, "alpha"],
        1,
        "certificate.policies[0].alpha",
        "unknown key",
    ),
    "bound as null": (
        ["certificate", "policies", 0, "bound"],
        None,
        "certificate.policies[0].bound",
        "number",
    ),
    "speed below zero": (
        ["certificate", "policies", 0, "speed"],
        -0.1,
        "certificate.policies[0].speed",
        "m/s",
    ),
    "speed as text": (
        ["certificate", "policies", 0, "speed"],
        "slow",
        "certificate.policies[0].speed",
        "number",
    ),
    "speed limit below zero": (
        ["certificate", "speed_limit"],
        -0.1,
        "certificate.speed_limit",
        "m/s",
    ),
    "speed limit as a flag": (
        ["certificate", "speed_limit"],
        True,
        "certificate.speed_limit",
        "number",
    ),
    "generation as a flag": (
        ["certificate", "policies", 0, "generation"],
        True,
        "certificate.policies[0].generation",
        "object",
    ),
    "generation of half a step": (
        ["certificate", "policies", 0, "generation"],
        {**MADE, "steps": 0.5},
        "certificate.policies[0].generation.steps",
        "integer",
    ),
    "requirement without a value": (
        ["certificate", "policies", 0, "generation"],
        {**MADE, "requirements": [REQUIREMENT, {**REQUIREMENT, "value": None}]},
        "certificate.policies[0].generation.requirements[1].value",
        "number",
    ),
    "accepted as a number": (
        ["certificate", "policies", 0, "accepted"],
        1,
        "certificate.policies[0].accepted",
        "true or false",
    ),
    "true for draws": (
        ["certificate", "policies", 0, "draws"],
        True,
        "certificate.policies[0].draws",
        "integer",
    ),
    "negative seed": (["seed"], -1, "seed", "[0, 2147483647]"),
    "seed as text": (["seed"], "7", "seed", "integer"),
}
CASES = [
    *((name, read_conditions, CONDITION, case) for name, case in BAD_CONDITIONS.items()),
    *((name, read_trials, TRIAL, case) for name, case in BAD_TRIALS.items()),
]


@pytest.mark.parametrize(
    ("read", "good", "case"),
    [case[1:] for case in CASES],
    ids=[f"{'trial' if good is TRIAL else 'condition'}: {name}" for name, _, good, _ in CASES],
)
def test_what_is_wrong_is_named(tmp_path, read, good, case):
    """In the second line, after a good one."""
    where, new, field, reason = case
    path = tmp_path / "bad.jsonl"
    path.write_bytes(line(good) + b"\n" + line(edited(good, where, new)) + b"\n")
    with pytest.raises(InputError) as caught:
        read(path)
    assert (caught.value.file, caught.value.line) == (path, 2)
    assert caught.value.field == field
    assert reason in caught.value.reason
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "one bridge trial a line"),
        (b"\n", "empty"),
        (b"[]\n", "object"),
        (line(TRIAL)[:-40], "not JSON"),
        (line(TRIAL).replace(b'"seed": 7', b'"seed": 7, "seed": 8'), "twice"),
        (b"\xff\xfe", "UTF-8"),
    ],
)
def test_what_is_no_trial_at_all_is_refused(tmp_path, content, reason):
    path = tmp_path / "bad.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=reason) as caught:
        read_trials(path)
    assert caught.value.line == 1


def test_the_longest_trial_fits_in_a_line(tmp_path):
    """60 policies of 4 actions, every number as long as numbers get."""
    number = -1.2345678901234567e-05
    digits = {"value": number, "limit": number, "excess": number, "smallest_ell_norm": -number}
    names = ("q_task", "q_safe", "speed")
    made = {
        **MADE,
        "first_failure": "robot 8 did not meet its row of q_safe at 1000000000 points",
        "requirements": [{**REQUIREMENT, **digits, "name": name} for name in names],
        "least_opposed_sine": -number,
        "largest_input_norm": -number,
        "largest_step": -number,
    }
    factors = {"q_task": number, "bound": number, "q_safe": number, "speed": -number}
    long = {
        **TRIAL,
        "twists": [[number] * 3] * 240,
        "poses": [TRIAL["poses"][0], *([[number] * 3] * 240)],
        "certificate": {
            **TRIAL["certificate"],
            "policies": [{**POLICY, **factors, "generation": made}] * 60,
        },
    }
    path = tmp_path / "long.jsonl"
    path.write_bytes(line(long) + b"\n")
    assert json.loads(line(read_trials(path)[0].to_json())) == long
