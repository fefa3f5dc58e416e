"""What a trial's line says against itself: every number recomputed, every contradiction told with its field."""

import copy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.bridge.condition import TrialCondition, centres
from deggflow.tasks.bridge.consistency import contradictions
from deggflow.tasks.bridge.factors import safe_factor, task_factor
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.bridge.oracle import least_margin, refutation
from deggflow.tasks.bridge.recomputed import q_safe, q_task, speed_violation, speeds
from deggflow.tasks.bridge.requirements import PROGRESS
from deggflow.tasks.bridge.task import BridgeTask
from deggflow.tasks.bridge.verdict import contact_speeds, execute, integrate
from deggflow.tasks.bridge.world import DT

CONTACTS = ((-2.4, 0.36), (-1.4, -0.36), (-0.9, 0.36))
PLANK = (-1.5, 0.1, 0.05)
TWISTS = np.tile([0.5, 0.01, -0.02], (14, 1))  # bridges with the twelfth action


def exactly(function, *arguments):
    with jax.enable_x64(True):
        return float(function(*(jnp.asarray(each) for each in arguments)))


def factors(poses, contacts=CONTACTS):
    """q_task of the last pose, q_safe of all, by the library's own factors."""
    with jax.enable_x64(True):
        r = centres(jnp.asarray(contacts, jnp.float64))
        safe = safe_factor(jnp.asarray(poses), r, jnp.ones(len(r), bool))
        return float(task_factor(jnp.asarray(poses[-1]))), float(safe)


def made(task, bound, safe):
    """A record as a generation in float32 leaves it."""
    blank = {"excess": -0.02, "active_points": 3, "smallest_ell_norm": 0.1}
    return {
        "hypotheses_hold": True,
        "first_failure": None,
        "requirements": [
            {"name": "q_task", "value": float(np.float32(task)), "limit": bound, **blank},
            {"name": "q_safe", "value": float(np.float32(safe)), "limit": 0.0, **blank},
        ],
        "steps": 50,
        "refused_steps": 0,
        "forced_steps": 0,
        "least_opposed_sine": None,
        "largest_input_norm": 1.5,
        "largest_step": 1.5,
    }


def honest(plank=PLANK, twists=TWISTS, contacts=CONTACTS):
    """A guided trial's line of these actions, every number by the library's own code."""
    verdict = execute(np.array(plank), twists, contacts)
    whole = integrate(np.array(plank), twists)
    policies = []
    for begin in range(0, verdict.actions, 4):
        poses, some = whole[begin : begin + 5], twists[begin : begin + 4]
        task, safe = factors(poses[1:], contacts)
        bound = exactly(task_factor, poses[0]) - PROGRESS
        speed = float(contact_speeds(some, np.array(contacts)).max())
        record = {"q_task": task, "bound": bound, "q_safe": safe, "draws": 1, "accepted": True}
        policies.append({**record, "speed": speed, "generation": made(task, bound, safe)})
    return {
        "condition": TrialCondition(plank, (-0.2, 0.0, 0.0), contacts).to_json(),
        "dt": DT,
        "twists": twists[: verdict.actions].tolist(),
        "poses": verdict.poses.tolist(),
        "outcome": {"success": verdict.bridged, "reason": verdict.reason},
        "certificate": {
            "satisfied": verdict.bridged,
            "min_margin": verdict.margin,
            "violation": 0.0,
            "draws": 1,
            "reason": verdict.reason,
            "policies": policies,
        },
        "seed": 0,
    }


@pytest.fixture(scope="module")
def line():
    return honest()


def edited(value, **changes):
    """A copy with fields of the certificate changed."""
    out = copy.deepcopy(value)
    out["certificate"].update(changes)
    return out


def said(value):
    """The fields in which something is found wrong."""
    parse_trial(value)
    return [wrong.field for wrong in contradictions(value)]


def test_recomputed_factors_are_the_librarys():
    rng = np.random.default_rng(0)
    for _ in range(40):
        poses = rng.uniform([-7, -3, -3.2], [6, 3, 3.2], (4, 3))
        task, safe = factors(poses)
        assert q_task(poses)[-1] == pytest.approx(task, rel=1e-12, abs=1e-12)
        assert q_safe(poses, np.array(CONTACTS)) == pytest.approx(safe, rel=1e-12, abs=1e-12)
        assert q_safe(poses[:2], np.array(CONTACTS)) <= safe + 1e-9
        twists = rng.normal(size=(4, 3))
        found = speeds(twists, np.array(CONTACTS)).max(axis=0)
        np.testing.assert_allclose(found, contact_speeds(twists, np.array(CONTACTS)))
    assert speed_violation(np.array([[0.3, 0, 0]]), np.array(CONTACTS), 0.3) == pytest.approx(6e-4)
    assert speed_violation(np.array([[0.27, 0, 0]]), np.array(CONTACTS), 0.3) == 0


def test_the_depth_of_a_failure_is_the_verdicts():
    rng = np.random.default_rng(1)
    for _ in range(12):
        plank = tuple(rng.uniform([-4, -1.5, -1], [-2, 1.5, 1]))
        value = honest(plank, np.tile(rng.normal(size=3), (20, 1)))
        found, spread = least_margin(value)
        assert found == pytest.approx(value["certificate"]["min_margin"], abs=max(1e-3, spread))


def test_nothing_is_wrong_with_an_honest_line(line):
    assert line["certificate"]["satisfied"]
    assert len(line["twists"]) == 12
    assert (refutation(line), said(line)) == (None, [])
    short = honest(twists=TWISTS * 1.2)
    assert len(short["twists"]) == 10  # the last policy is cut short by the bridge
    assert said(short) == []
    failed = honest((-3.5, 2.0, 0.0), np.tile([0.0, 0.4, 0.0], (20, 1)))
    assert not failed["outcome"]["success"]
    assert refutation(failed) is None


CLAIMS = {
    "satisfied with a reason": ({"reason": "because"}, ["certificate.reason"]),
    "not satisfied, without one": (
        {"satisfied": False},
        ["certificate.satisfied", "certificate.reason"],
    ),
    "a violation": ({"violation": 5.0}, ["certificate.violation"]),
    "other draws": ({"draws": 2}, ["certificate.draws"]),
    "a margin": ({"min_margin": 0.05}, ["certificate.min_margin"]),
    "no policies": ({"policies": []}, ["certificate.policies"]),
}


@pytest.mark.parametrize("what", CLAIMS)
def test_claims_that_contradict_are_told_with_their_fields(line, what):
    changes, fields = CLAIMS[what]
    assert said(edited(line, **changes)) == fields


def test_a_policy_that_is_dropped_is_missed(line):
    policies = line["certificate"]["policies"]
    for k in range(len(policies)):
        assert "certificate.policies" in said(
            edited(line, policies=policies[:k] + policies[k + 1 :])
        )


@pytest.mark.parametrize("name", ["q_task", "bound", "q_safe", "speed"])
def test_a_policys_numbers_are_those_of_its_twists(line, name):
    for k in range(3):
        policies = copy.deepcopy(line["certificate"]["policies"])
        policies[k][name] += 1e-4
        assert f"certificate.policies[{k}].{name}" in said(edited(line, policies=policies))


def test_of_a_policy_that_is_cut_short_only_what_was_executed_is_known():
    short = honest(twists=TWISTS * 1.2)
    for change, fields in ((0.01, []), (-0.01, ["certificate.policies[2].speed"])):
        policies = copy.deepcopy(short["certificate"]["policies"])
        policies[2]["speed"] += change
        assert said(edited(short, policies=policies)) == fields


def test_a_guided_policy_that_misses_a_bound_was_not_accepted(line):
    value = copy.deepcopy(line)
    slow = honest(twists=TWISTS * 0.01)
    value = {**slow, "outcome": {"success": False, "reason": "too slow"}}
    value["certificate"] = {**slow["certificate"], "reason": "too slow"}
    policies = value["certificate"]["policies"]
    assert any(policy["q_task"] > policy["bound"] for policy in policies)
    assert "certificate.policies[0].accepted" in said(value)
    nominal = [{k: v for k, v in policy.items() if k != "generation"} for policy in policies]
    assert "certificate.policies[0].accepted" not in said(edited(value, policies=nominal))


def test_records_are_of_the_policies_they_stand_in(line):
    def with_record(**changes):
        policies = copy.deepcopy(line["certificate"]["policies"])
        policies[1]["generation"].update(changes)
        return said(edited(line, policies=policies))

    rows = line["certificate"]["policies"][1]["generation"]["requirements"]
    place = "certificate.policies[1].generation"
    assert with_record(requirements=rows[:1]) == [f"{place}.requirements"]
    assert with_record(hypotheses_hold=False) == [f"{place}.first_failure"]
    assert with_record(forced_steps=1) == [f"{place}.forced_steps"]
    for name in ("value", "limit"):
        other = [{**rows[0], name: rows[0][name] + 0.01, "excess": 0.0}, rows[1]]
        assert f"{place}.requirements[0].{name}" in with_record(requirements=other)
    gone = copy.deepcopy(line["certificate"]["policies"])
    del gone[1]["generation"]
    assert said(edited(line, policies=gone)) == [place]


def test_another_condition_than_was_asked_for_is_told(line):
    given = parse_trial(line).condition
    assert BridgeTask.formats.difference(given, given) is None
    for asked, field in (
        (TrialCondition((-1.5, 0.1, 0.06), given.goal, given.contacts), "plank.theta"),
        (TrialCondition(given.plank, (-0.3, 0.0, 0.0), given.contacts), "goal.x"),
        (TrialCondition(given.plank, given.goal, (*CONTACTS, (0.0, 0.36))), "contacts"),
        (TrialCondition(given.plank, given.goal, ((-2.5, 0.36), *CONTACTS[1:])), "contacts[0][0]"),
    ):
        assert BridgeTask.formats.difference(asked, given).field == f"condition.{field}"
