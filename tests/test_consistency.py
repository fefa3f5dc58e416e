"""Contradictions inside a generation's record, one at a time, and the first difference of two JSON values."""

import copy

import pytest

from deggflow.consistency import (
    RECORD,
    check_claim,
    check_generation,
    first_difference,
    unverified_line,
)

NAMES, AGENTS = ["one", "two"], ["a", "b"]
HELD = {
    "hypotheses_hold": True,
    "first_failure": None,
    "requirements": [
        {
            "name": "one",
            "value": -0.2,
            "limit": 0.0,
            "excess": -0.1,
            "active_points": 4,
            "smallest_ell_norm": 0.3,
        },
        {
            "name": "two",
            "value": 0.1,
            "limit": 0.1,
            "excess": 0.0,
            "active_points": 0,
            "smallest_ell_norm": None,
        },
    ],
    "steps": 10,
    "refused_steps": 2,
    "forced_steps": 0,
    "least_opposed_sine": 0.5,
    "largest_input_norm": 1.0,
    "largest_step": 1.0,
    "trace": {
        "tau": [0.0, 0.5, 1.0],
        "value": [[0.4, 0.0], [0.1, 0.1], [-0.2, 0.1]],
        "bound": [[0.5, 0.5], [0.2, 0.2], [0.0, 0.1]],
        "limit": [[0.5, 0.5], [0.3, 0.2], [0.0, 0.1]],
    },
}
FAILED = {
    **HELD,
    "hypotheses_hold": False,
    "first_failure": "two was above its limit by 0.25, 3 steps were forced: two at b, two has no gradient (a kink) at 1 point",
    "requirements": [
        HELD["requirements"][0],
        {
            **HELD["requirements"][1],
            "excess": 0.25,
            "forced_steps": 3,
            "forced_agents": ["b"],
            "kink_points": 1,
        },
    ],
    "forced_steps": 3,
}


def edited(value, path, new):
    out = copy.deepcopy(value)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    place[last] = new
    return out


def fields(made):
    return [wrong.field for wrong in check_generation(made, "g", NAMES, AGENTS)]


@pytest.mark.parametrize("made", [HELD, FAILED])
def test_nothing_is_wrong_with_an_honest_record(made):
    assert fields(made) == []
    assert fields({k: v for k, v in made.items() if k != "trace"}) == []


ROW, TRACE = ("requirements", 1), ("trace",)
WRONG = {
    "hypotheses hold and a failure": (HELD, ("first_failure",), "because", ["g.first_failure"]),
    "hypotheses hold and forced": (HELD, ("forced_steps",), 1, ["g.forced_steps"]),
    "hypotheses hold and above": (HELD, (*ROW, "excess"), 0.1, ["g.requirements[1].excess"]),
    "hypotheses hold with a kink": (HELD, (*ROW, "kink_points"), 1, ["g.requirements[1].kink_points"]),
    "hypotheses do not hold, no word": (FAILED, ("first_failure",), None, ["g.first_failure"]),
    "an empty word": (FAILED, ("first_failure",), "", ["g.first_failure"]),
    "another requirement is blamed": (
        FAILED,
        ("first_failure",),
        FAILED["first_failure"].replace("two was", "one was"),
        ["g.first_failure"],
    ),
    "another excess is told": (FAILED, ("first_failure",), FAILED["first_failure"].replace("0.25", "0.26"), ["g.first_failure"]),
    "other forced steps are told": (FAILED, ("first_failure",), FAILED["first_failure"].replace("3 ", "4 "), ["g.first_failure"]),
    "no kink is told": (FAILED, ("first_failure",), FAILED["first_failure"].split(", two has")[0], ["g.first_failure"]),
    "more points than there are": (
        FAILED,
        ("first_failure",),
        "b did not meet its row of two at 12 points",
        ["g.first_failure"],
    ),
    "the excess hides the end": (HELD, (*ROW, "value"), 0.2, ["g.requirements[1].excess", "g.trace.value[2][1]"]),
    "active too often": (HELD, (*ROW, "active_points"), 12, ["g.requirements[1].active_points"]),
    "more forced than all": (FAILED, (*ROW, "forced_steps"), 4, ["g.requirements[1].forced_steps"]),
    "forced by nobody": (FAILED, (*ROW, "forced_agents"), [], ["g.requirements[1].forced_agents"]),
    "forced by a stranger": (FAILED, (*ROW, "forced_agents"), ["c"], ["g.requirements[1].forced_agents[0]"]),
    "another requirement": (HELD, (*ROW, "name"), "three", ["g.requirements"]),
    "active without input": (HELD, ("largest_input_norm",), 0.0, ["g.largest_input_norm"]),
    "input though none had to act": (HELD, ("requirements", 0, "smallest_ell_norm"), None, ["g.requirements"]),
    "tau falls": (HELD, (*TRACE, "tau"), [0.0, 0.0, 1.0], ["g.trace.tau"]),
    "tau ends early": (HELD, (*TRACE, "tau", 2), 0.9, ["g.trace.tau"]),
    "more points than steps": (HELD, ("steps",), 1, ["g.trace.tau", "g.requirements[0].active_points"]),
    "the trace ends otherwise": (HELD, (*TRACE, "value", 2, 0), -0.3, ["g.trace.value[2][0]"]),
    "its limit ends otherwise": (HELD, (*TRACE, "limit", 2, 0), 0.1, ["g.trace.limit[2][0]"]),
    "the trace is above": (HELD, (*TRACE, "value", 1, 0), 0.4, ["g.trace.value[1][0]"]),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_contradiction_is_told_with_its_field(what):
    made, path, new, expected = WRONG[what]
    assert sorted(fields(edited(made, path, new))) == sorted(expected)


def test_one_requirement_alone_has_nothing_opposed():
    alone = {**HELD, "requirements": HELD["requirements"][:1]}
    del alone["trace"]
    found = [wrong.field for wrong in check_generation(alone, "g", NAMES[:1], AGENTS)]
    assert found == ["g.least_opposed_sine"]


def test_claims_have_a_reason_or_are_satisfied():
    def said(satisfied, reason, verdicts=()):
        claim = {"satisfied": satisfied, "reason": reason, "verdicts": verdicts}
        return [wrong.field for wrong in check_claim(claim, "c")]

    assert said(True, None) == said(False, "because") == []
    assert said(True, "because") == said(False, None) == said(False, "") == ["c.reason"]
    good, bad = {"margin": 0.1, "reason": None}, {"margin": -0.1, "reason": "because"}
    assert said(True, None, [good]) == said(False, "because", [good, bad]) == []
    assert said(True, None, [bad]) == ["c.verdicts[0].margin"]
    assert said(False, "because", [{**good, "reason": "because"}]) == ["c.verdicts[0].reason"]


def test_the_first_difference_is_told():
    asked = {"a": [1, {"b": 2.0}], "c": None}
    assert first_difference(asked, copy.deepcopy(asked)) is None
    assert first_difference(asked, {"a": [1.0, {"b": 2}], "c": None}) is None
    for given, text in (
        ({"a": [1, {"b": 3}], "c": 1}, "field `a[1].b` is 3; 2.0 was requested"),
        ({"a": [1], "c": None}, "field `a` has 1 entries; 2 were requested"),
        ({"a": asked["a"]}, "field `c` is missing; null was requested"),
        ({**asked, "d": 1}, "field `d` is 1, which was not requested"),
        ({**asked, "c": {"x": 1}}, 'field `c` is {"x": 1}; null was requested'),
    ):
        assert str(first_difference(asked, given)) == text


def test_what_is_not_verified_is_named_in_one_line():
    line = unverified_line({"seed": "", **{f"c.generation.{k}": v for k, v in RECORD.items()}})
    assert len(line.splitlines()) == 1
    assert line.startswith("Cannot be verified from the file: seed, c.generation.{first_failure (")
    assert line.endswith("trace (before its end)}.")
