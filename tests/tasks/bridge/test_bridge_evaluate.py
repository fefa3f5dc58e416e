"""The replay agrees with the verdict and refutes what is not so; counts add up."""

import copy
import json

import numpy as np
import pytest

from deggflow.schema import parse_as
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.evaluate import (
    KINDS,
    SOURCES,
    SYMMETRIC,
    Evaluation,
    Modes,
    Passes,
    PolicyCounts,
    count_modes,
    count_policies,
    demonstrated,
    failure_kind,
)
from deggflow.tasks.bridge.expert import random_demonstration
from deggflow.tasks.bridge.oracle import PARTS, judge, refutation, replay
from deggflow.tasks.bridge.trial import PolicyRecord, Trial, TrialCertificate
from deggflow.tasks.bridge.verdict import bridges, execute, margins, sub_poses

MET = PolicyRecord(-0.5, -0.4, -1.0, 1, True)


def trial_of(condition, twists, policies=(MET,)):
    """What the verdict says of some actions, as a trial in a file."""
    start = margins(np.array([condition.plank]), condition.contacts)
    verdict = execute(np.array(condition.plank), twists, condition.contacts)
    reason = verdict.reason
    if start.least()[0] < 0:
        verdict = execute(np.array(condition.plank), np.zeros((0, 3)), condition.contacts)
        reason = f"at the start {start.reason(0)}"
    elif reason is None and not bridges(verdict.poses[-1]):
        reason = "not bridged after 60 policies"
    done = reason is None
    certificate = TrialCertificate(done, verdict.margin, 0.0, 1, reason, tuple(policies))
    trial = Trial(
        condition, twists[: verdict.actions], verdict.poses, done, reason, certificate, seed=0
    )
    return json.loads(json.dumps(trial.to_json()))


def pushed(number, robots):
    """A demonstration that a smooth push leads astray, more or less."""
    demonstration = random_demonstration(robots, 3, number)
    rng = np.random.default_rng([number, robots])
    push = rng.normal(size=3) * [0.25, 0.25, 0.15] * rng.choice([0.0, 0.4, 1.0])
    return demonstration.condition, demonstration.twists + push


@pytest.fixture(scope="module")
def trials():
    """Of every kind: bridged, broken in each way, unfinished, over before they begin."""
    found = [trial_of(*pushed(number, robots)) for robots in (2, 5, 8) for number in range(12)]
    still, forward = np.zeros((5, 3)), np.tile([0.4, 0.0, 0.0], (60, 1))
    behind, ahead = ((-2.5, 0.36), (-2.5, -0.36)), ((-2.5, 0.36), (2.0, -0.36))
    steep = 1.2  # rad; pushed over the gap, the plank reaches neither ground
    over = np.tile([0.4 * np.cos(steep), -0.4 * np.sin(steep), 0.0], (60, 1))
    for plank, contacts, twists in (
        ((-3.2, 0.0, 0.0), behind, still),
        ((-1.0, 0.0, 0.0), ahead, forward),  # a robot stands in the gap
        ((-4.5, 0.0, 0.0), behind, forward),  # out of the workspace
        ((-0.2, 0.0, 0.0), behind, still[:0]),  # bridges already
        ((-2.8, 0.0, 0.0), ((-2.5, 0.36), (1.5, -0.36)), forward),
        ((-1.5, 0.0, steep), ((-2.5, 0.36), (-2.0, 0.36)), over),
        ((0.9, 0.0, 1.5), ((-2.5, 0.36), (-2.5, -0.36)), still),  # no support at all
    ):
        condition = TrialCondition(plank, (-0.2, 0.0, 0.0), contacts)
        found.append(trial_of(condition, twists))
    return found


def test_the_replay_finds_the_verdicts_margins_and_refutes_nothing(trials):
    kinds = set()
    for value in trials:
        kinds.add(failure_kind(value["outcome"]["reason"] or "bridged"))
        motion = judge(value, replay(value))
        poses = np.array(value["poses"])
        passed = sub_poses(poses[:-1], np.array(value["twists"]).reshape(-1, 3), PARTS)
        poses = np.concatenate([poses[:1], passed.reshape(-1, 3)])
        theirs = margins(poses, value["condition"]["contacts"]).least()
        inside = theirs > 0
        np.testing.assert_allclose(motion.least[inside], theirs[inside], atol=1e-9)
        assert (motion.least[~inside] <= 1e-9).all()
        assert refutation(value) is None
    assert kinds == {*KINDS, "other"}  # "other": bridged


def edited(value, path, new):
    out = copy.deepcopy(value)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    place[last] = new
    return out


@pytest.fixture(scope="module")
def bridged():
    demonstration = random_demonstration(3, 1, 0)
    return demonstration, trial_of(demonstration.condition, demonstration.twists)


def test_tampered_trials_are_refuted(bridged):
    demonstration, good = bridged
    actions = len(good["twists"])
    assert refutation(good) is None
    for path, new, text in (
        (["poses", 5, 0], good["poses"][5][0] + 1e-6, "pose 5 is not where the twists lead"),
        (["poses", 5, 2], good["poses"][5][2] + 1e-6, "pose 5 is"),
        (["twists", 4, 1], good["twists"][4][1] + 1e-6, "pose 5 is"),
        (["twists"], good["twists"][1:], "poses for"),
        (["dt"], 0.1, "pose 1 is"),
        (["condition", "plank", "y"], good["condition"]["plank"]["y"] + 0.01, "pose 0 is"),
        (["outcome"], {"success": False, "reason": "blocked"}, "bridges the gap unharmed"),
        (["certificate", "min_margin"], 2.0, "the least margin is"),
        (["certificate", "policies", 0, "q_safe"], 0.1, "a policy that misses a bound"),
        (["certificate", "policies", 0, "accepted"], False, "a policy that misses a bound"),
    ):
        assert text in refutation(edited(good, path, new))
    # A whole turn more is the same pose.
    turned = [[x, y, theta + 2 * np.pi] for x, y, theta in good["poses"]]
    assert refutation(edited(good, ["poses"], turned)) is None
    # A success that isn't: two actions short of the bridge.
    short = {**good, "twists": good["twists"][:-2], "poses": good["poses"][:-2]}
    assert refutation(short) == "the plank does not bridge the gap unharmed"
    # A trial that goes on after bridging.
    on = demonstration.twists[: actions + 1]
    poses = np.array(good["poses"])
    after = sub_poses(poses[-1], on[-1], 1)
    longer = {**good, "twists": on.tolist(), "poses": np.concatenate([poses, after]).tolist()}
    assert (
        refutation(longer) == f"the trial goes on after action {actions}, where the gap is bridged"
    )


def test_false_reasons_are_refuted(trials):
    def with_reason(value, reason, success=False):
        return edited(value, ["outcome"], {"success": success, "reason": reason})

    failed = {
        kind: next(
            v for v in trials if kind == failure_kind(v["outcome"]["reason"] or "") and v["twists"]
        )
        for kind in KINDS
    }
    for kind in ("plank_leaves", "support_lost", "robot_leaves", "robot_in_gap"):
        value = failed[kind]
        assert refutation(with_reason(value, None, True)) is not None
        assert "not told" in refutation(with_reason(value, "not bridged after 60 policies"))
        assert "there is no robot 9" in refutation(with_reason(value, "robot 9 enters the gap"))
        wrong = "support_lost" if kind != "support_lost" else "plank_leaves"
        assert refutation(with_reason(value, KINDS[wrong])) == f"it is not so that {KINDS[wrong]}"
        certified = edited(value, ["certificate", "satisfied"], True)
        assert refutation(certified) == "a trial that failed is certified"
    slow = failed["time_out"]
    assert "it is not so" in refutation(with_reason(slow, "robot 1 enters the gap"))
    # A trial that goes on after a failure: one more action at rest.
    value = failed["plank_leaves"]
    longer = {
        **value,
        "twists": [*value["twists"], [0, 0, 0]],
        "poses": [*value["poses"], value["poses"][-1]],
    }
    assert "where something fails" in refutation(longer)


def test_policies_are_counted_one_by_one():
    records = (
        MET,
        PolicyRecord(-0.5, -0.4, -1.0, 3, True),  # met when it was drawn again
        PolicyRecord(-0.3, -0.4, -1.0, 1, True),  # a nominal one that misses its bound
        PolicyRecord(-0.3, -0.4, -1.0, 8, False),  # blocked
    )
    certificate = TrialCertificate(True, 0.1, 0.0, 8, None, records)
    trial = Trial(SYMMETRIC, np.zeros((0, 3)), np.zeros((1, 3)), True, None, certificate, 0)
    assert count_policies([trial, trial]) == PolicyCounts(8, 2, 4, 8)
    assert count_policies([]) == PolicyCounts(0, 0, 0, 0)
    assert str(PolicyCounts(8, 2, 4, 8).rate(4)).startswith("50.0%")


def test_rows_come_back_from_a_file():
    counts = PolicyCounts(10, 9, 10, 2)
    row = Evaluation(4, 2, 1, {"other": 1}, 2, ["a"], 0.1, {"nominal": counts}, [])
    assert parse_as(Evaluation, json.loads(json.dumps(row.to_json()))) == row


def test_passes_on_either_side_are_told_apart():
    def way(*y):
        return Passes(np.array([[-3.0, value, 0.0] for value in y]), True)

    found = [
        way(0, 0.5, -0.1),
        way(0, -0.7, 0.6),
        way(0, 0.2, 0),
        Passes(way(0, -0.3).poses, False),
    ]
    modes = count_modes("nominal", found)
    assert (modes.trials, modes.bridged, modes.left) == (4, 3, 2)
    assert modes.median == pytest.approx(0.4)
    assert modes.low < 0.3 < modes.high < 0.7
    assert Modes(**json.loads(json.dumps(modes.to_json()))) == modes


def test_demonstrations_from_the_symmetric_start_pass_on_both_sides():
    points = {tuple(np.round(point, 9)) for point in SYMMETRIC.contacts}
    assert {(x, -y) for x, y in points} == points
    found = demonstrated(30, 0)
    assert count_modes(SOURCES[0], found).bridged == 30
    assert 5 <= count_modes(SOURCES[0], found).left <= 25
    np.testing.assert_array_equal(found[0].poses[0], SYMMETRIC.plank)
