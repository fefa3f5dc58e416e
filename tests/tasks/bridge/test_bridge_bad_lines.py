"""Bridge conditions and trials as JSON Lines: what is not valid is named."""

import math

import pytest
from bridge_lines import CONDITION, MADE, REQUIREMENT, TRIAL, edited, line

from deggflow.jsonl import InputError
from deggflow.tasks.bridge.formats import read_conditions, read_trials

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
