"""Bridge conditions and trials as JSON Lines: what is valid comes back as it was."""

import json
import math

import numpy as np
import pytest
from bridge_lines import CONDITION, MADE, POLICY, REQUIREMENT, TRIAL, edited, line
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.jsonl import InputError, parse_line
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.formats import parse_condition, parse_trial, read_trials

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
