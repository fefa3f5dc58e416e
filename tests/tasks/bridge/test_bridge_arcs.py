"""Between the poses that are examined, however fast: the whole arc counts, by the verdict and by the replay."""

import math

import numpy as np
import pytest

from deggflow.tasks.bridge.oracle import TOLERANCE, judge, refine_replay, refutation, replay
from deggflow.tasks.bridge.verdict import execute, integrate, margins, move
from deggflow.tasks.bridge.world import DT

CONTACTS = ((-2.4, 0.36), (-1.4, -0.36), (-0.9, 0.36))
SPINNING = 2 * math.pi / 3 * 8 / DT  # rad/s; a third of a turn in an eighth of an action
FIRST = (0.0, 0.0, SPINNING)


def trial(plank, twists, success=True, reason=None, margin=0.1):
    """As it stands in a file; the poses are where the twists lead."""
    twists = np.array(twists, np.float64).reshape(-1, 3)
    names = ("x", "y", "theta")
    return {
        "condition": {
            "plank": dict(zip(names, plank, strict=True)),
            "goal": {"x": -0.2, "y": 0.0, "theta": 0.0},
            "contacts": [list(r) for r in CONTACTS],
        },
        "dt": DT,
        "twists": twists.tolist(),
        "poses": integrate(np.array(plank), twists).tolist(),
        "outcome": {"success": success, "reason": reason},
        "certificate": {
            "satisfied": success,
            "min_margin": margin,
            "violation": 0.0,
            "draws": 1,
            "reason": reason,
            "policies": [],
        },
        "seed": 0,
    }


def dense(plank, twists, many=20_001):
    """Least margin over very many poses of every action."""
    found, pose = math.inf, np.array(plank)
    for twist in np.array(twists, np.float64):
        poses = np.array([move(pose, twist, t) for t in np.linspace(0.0, DT, many)])
        found, pose = min(found, margins(poses, CONTACTS).least().min()), poses[-1]
    return float(found)


ACROSS = (-3.9, 0.25, 0.0)  # turned upright, the plank reaches 0.15 m over the workspace's side
TO_THE_BRIDGE = [[1.0, -0.05, 0.0]] * 18


def test_turning_a_third_between_two_poses_hides_nothing():
    """The plank is inside at all eight poses of each action, and outside between them."""
    value = trial(ACROSS, [FIRST] * 3 + TO_THE_BRIDGE)
    poses = judge(value, replay(value))
    assert poses.least.min() > 0
    assert dense(ACROSS, [FIRST], 2_001) < -0.1
    verdict = execute(np.array(ACROSS), np.array(value["twists"]), CONTACTS)
    assert (verdict.reason, verdict.actions) == ("the plank leaves the workspace", 1)
    assert verdict.margin == pytest.approx(3 - 0.25 - math.hypot(2.9, 0.36), abs=1e-9)
    assert refutation(value) == "the trial goes on after action 1, where something fails"
    told = trial(ACROSS, [FIRST], False, verdict.reason, verdict.margin)
    assert refutation(told) is None
    unjust = trial(ACROSS, [FIRST], False, "robot 1 leaves the workspace", verdict.margin)
    assert refutation(unjust) == "it is not so that robot 1 leaves the workspace"


def test_a_gap_that_is_jumped_over_between_two_poses_is_entered():
    """100 m/s: 2.5 m in an eighth of an action, from the left ground to the right one."""
    contacts = ((0.1, 0.36),)
    start, twist = np.array([-0.3, 0.0, 0.0]), np.array([[100.0, 0.0, 0.0]])
    ends = np.stack([start, move(start, twist[0], DT / 8)])
    assert margins(ends, contacts).gap.min() > 0
    assert execute(start, twist, contacts).reason == "robot 1 enters the gap"
    value = trial(start, twist)
    value["condition"]["contacts"] = [list(r) for r in contacts]
    observation = refine_replay(value, replay(value)).motion
    assert observation.gap.min() == pytest.approx(-0.16, abs=1e-6)  # inside: only its sign counts


def random_motions(count):
    rng = np.random.default_rng(5)
    for k in range(count):
        plank = rng.uniform([-5, -2, -3.2], [2, 2, 3.2])
        scale = 10.0 ** rng.uniform(-2, 2)
        yield plank, rng.uniform(-scale, scale, (1, 3)) * (1, 1, k % 4 > 0)


@pytest.mark.parametrize("number", range(24))
def test_the_margin_is_that_of_the_whole_arc(number):
    """Against very many poses: never above their least, and below it only by what lies between them."""
    plank, twist = list(random_motions(24))[number]
    (passed,) = [execute(plank, twist, CONTACTS).margin]
    found = dense(plank, twist, 8_001)
    v, turn = np.hypot(*twist[0, :2]), abs(twist[0, 2])
    between = (v + 3 * turn) * DT / 8_000
    assert found - between <= passed <= found + 1e-9


@pytest.mark.parametrize("off", [-1e-5, -3e-8, 3e-8, 1e-5])
def test_the_replay_decides_to_a_few_hundredths_of_a_micrometre(off):
    """A plank that spins beside the workspace's side, once just inside and once just over it."""
    y = 3 - math.hypot(2.9, 0.36) - off
    value = trial((-3.9, y, 0.3), [[0.0, 0.0, 71.0]])
    observation = refine_replay(value, replay(value)).motion
    assert (observation.least.min() >= -TOLERANCE) == (off > 0)
    verdict = execute(np.array([-3.9, y, 0.3]), np.array(value["twists"]), CONTACTS)
    assert (verdict.reason is None) == (off > 0)
    assert verdict.margin == pytest.approx(off, abs=1e-12)


def test_ordinary_motion_is_looked_at_nowhere_else():
    """What it costs: nothing where nothing is close."""
    value = trial((-3.2, 0.0, 0.05), [[0.4, 0.02, 0.1]] * 8)
    observation = refine_replay(value, replay(value))
    assert len(observation.action) == 1 + 8 * 8
    np.testing.assert_array_equal(observation.ends, np.arange(0, 65, 8))
