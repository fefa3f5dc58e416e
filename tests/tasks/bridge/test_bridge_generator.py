"""Trials in receding horizon: what was executed, what is claimed of it, and what happens where nothing works."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely.geometry import box

from deggflow.tasks.bridge.codec import continuation
from deggflow.tasks.bridge.condition import BridgeCondition, TrialCondition
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.generator import BridgeGenerator
from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions

DT, RADIUS, EXACT, SEED = 0.2, 0.16, 1e-9, 6
CORNERS = np.array([2.9 + 0.36j, 2.9 - 0.36j, -2.9 - 0.36j, -2.9 + 0.36j])
WORKSPACE = box(-7, -3, 6.8, 3)
GROUNDS = WORKSPACE.difference(box(0, -3, 2, 3))

# Contacts so far forward that the robots stand at the gap before the plank reaches the other side.
BLOCKED = TrialCondition(
    (-3.2, 0.0, 0.0), (-0.3, 0.0, 0.0), ((0.6, 0.36), (1.2, 0.36), (0.6, -0.36), (1.2, -0.36))
)
BROKEN = TrialCondition((-3.2, 2.9, 0.0), (-0.3, 0.0, 0.0), ((-0.6, 0.36), (-0.6, -0.36)))
BRIDGED = TrialCondition((-0.3, 0.0, 0.0), (-0.3, 0.0, 0.0), ((-0.6, 0.36), (-0.6, -0.36)))


@pytest.fixture(scope="module")
def field():
    return load_field()


@pytest.fixture(scope="module")
def guided(field):
    return BridgeGenerator(field, bridge_guidance(field.scales))


@pytest.fixture(scope="module")
def nominal(field):
    return BridgeGenerator(field)


@pytest.fixture(scope="module")
def conditions():
    return [random_conditions(robots, 1, 30 + k)[0] for k, robots in enumerate((2, 4, 6))]


def one_by_one(generator, conditions, **settings):
    """Each trial in a batch of its own."""
    return [
        generator.trials([c], seed=SEED, first=k, **settings)[0] for k, c in enumerate(conditions)
    ]


@pytest.fixture(scope="module")
def trials(guided, nominal, conditions):
    return {"guided": one_by_one(guided, conditions), "nominal": one_by_one(nominal, conditions)}


@pytest.fixture(scope="module")
def blocked(guided):
    return guided.trials([BLOCKED], seed=SEED, max_draws=2)[0]


def driven(pose, twists, parts=1):
    """Poses `parts` times an action, the initial one first, by chords of circles in complex numbers."""
    moves = np.repeat(np.reshape(twists, (-1, 3)), parts, axis=0) * DT / parts
    angle = moves[:, 2]
    turn = pose[2] + np.concatenate([[0.0], np.cumsum(angle)])
    chord = np.where(angle == 0, 1.0, np.expm1(1j * angle) / np.where(angle == 0, 1.0, 1j * angle))
    steps = np.exp(1j * turn[:-1]) * chord * (moves[:, 0] + 1j * moves[:, 1])
    place = complex(pose[0], pose[1]) + np.concatenate([[0.0], np.cumsum(steps)])
    return np.stack([place.real, place.imag, turn], -1)


def outlines(poses):
    world = (poses[:, 0] + 1j * poses[:, 1])[:, None] + np.exp(1j * poses[:, 2:]) * CORNERS
    return np.stack([world.real, world.imag], -1)


def robots(condition, poses):
    contacts = np.array(condition.contacts)
    local = contacts[:, 0] + 0.52j * np.sign(contacts[:, 1])
    world = (poses[:, 0] + 1j * poses[:, 1])[:, None] + np.exp(1j * poses[:, 2:]) * local
    return np.stack([world.real, world.imag], -1)


def safe(condition, twists, parts=6):
    """By Shapely: plank inside, disks on the grounds, support on one side; also between the poses."""
    poses = driven(condition.plank, twists, parts)
    corners = outlines(poses)
    on_ground = GROUNDS.buffer(EXACT - RADIUS, join_style="mitre")
    support = np.maximum(-corners[..., 0].min(1), corners[..., 0].max(1) - 2)
    return bool(
        shapely.covers(WORKSPACE, shapely.polygons(corners)).all()
        and shapely.covers(on_ground, shapely.points(robots(condition, poses))).all()
        and support.min() >= 0.55
    )


def bridging(poses):
    x = outlines(poses)[..., 0]
    way = 2.665 * np.abs(np.cos(poses[:, 2]))
    reaches = (poses[:, 0] - way <= -0.05) & (poses[:, 0] + way >= 2.05)
    return (x.min(1) <= -0.55) & (x.max(1) >= 2.55) & reaches


def every(trials):
    return [trial for some in trials.values() for trial in some]


def test_poses_are_the_integral_of_the_twists(trials, blocked):
    for trial in [*every(trials), blocked]:
        assert len(trial.poses) == len(trial.twists) + 1
        np.testing.assert_allclose(
            trial.poses, driven(trial.condition.plank, trial.twists), atol=1e-9
        )


def test_outcomes_are_true(trials, blocked):
    """A trial succeeds exactly if its last pose bridges, none before does, and nothing fails on the way."""
    for trial in [*every(trials), blocked]:
        found = bridging(trial.poses)
        assert not found[:-1].any()
        assert trial.success == (bool(found[-1]) and safe(trial.condition, trial.twists))
        assert (trial.reason is None) == trial.success


def test_guided_trials_succeed_and_are_certified(trials):
    for trial in trials["guided"]:
        assert trial.success
        assert trial.certificate.satisfied
        assert trial.certificate.reason is None
        assert trial.certificate.violation == 0
        assert safe(trial.condition, trial.twists)
        assert trial.certificate.min_margin >= 0


def test_certificates_follow_from_their_policies(trials, blocked):
    """Satisfied: bridged, nothing failed, every executed policy below its bounds."""
    for trial in [*every(trials), blocked]:
        certificate = trial.certificate
        done = [p for p in certificate.policies if p.accepted]
        met = all(p.q_task <= p.bound and p.q_safe <= 0 for p in done)
        assert certificate.satisfied == (trial.success and met)
        assert (certificate.reason is None) == certificate.satisfied
        assert certificate.draws == max(p.draws for p in certificate.policies)
        excess = [max(p.q_task - p.bound, p.q_safe, 0.0) for p in done]
        assert certificate.violation == pytest.approx(max(excess), abs=1e-12)
        assert 4 * (len(done) - 1) < len(trial.twists) <= 4 * len(done)


def test_the_least_margin_is_that_of_everything_executed(trials):
    """Between four and six looks at every action differ by millimetres."""
    for trial in every(trials):
        poses = driven(trial.condition.plank, trial.twists, 24)
        corners, disks = outlines(poses), robots(trial.condition, poses)
        inside = min(
            (corners - [-7, -3]).min(),
            ([6.8, 3] - corners).min(),
            (disks - [-7, -3]).min() - RADIUS,
            ([6.8, 3] - disks).min() - RADIUS,
        )
        off_gap = np.maximum(-disks[..., 0], disks[..., 0] - 2).min() - RADIUS
        support = np.maximum(-corners[..., 0].min(1), corners[..., 0].max(1) - 2).min() - 0.55
        least = min(inside, off_gap, support)
        assert trial.certificate.min_margin == pytest.approx(least, abs=5e-3)
        assert trial.certificate.min_margin >= least - 1e-9


def log_sum_exp(exponents, sharpness):
    exponents = np.asarray(exponents)
    top = exponents.max()
    return float(top + np.log(np.exp(exponents - top).sum())) / sharpness


def q_task(pose):
    """Paper, App. on Task 1."""
    x, y, theta = pose
    cos, sin = abs(math.cos(theta)), abs(math.sin(theta))
    reach, side, way = 2.9 * cos + 0.36 * sin, 2.9 * sin + 0.36 * cos, 2.665 * cos
    m = [
        -x + reach - 0.55,
        x + reach - 2.55,
        -x + way - 0.05,
        x + way - 2.05,
        3 - y - side,
        y - side + 3,
    ]
    return log_sum_exp(-80 * np.array(m) / [0.55, 0.55, 0.2, 0.2, 0.2, 0.2], 80)


def q_safe(condition, poses):
    corners, disks = outlines(poses), robots(condition, poses)
    one, two = -corners[..., 0].min(1) - 0.55, corners[..., 0].max(1) - 2.55
    support = (one + two + np.hypot(one - two, 0.02) - 0.02) / 2
    plank = [2.8 - corners[..., 1].max(1), corners[..., 1].min(1) + 2.8, support]
    of_robots = [-0.26 - disks[..., 0], 2.74 - disks[..., 1], disks[..., 1] + 2.74]
    margins = np.concatenate([np.ravel(plank), np.ravel(of_robots)])
    return log_sum_exp(-60 * margins / 0.1, 60)


@pytest.mark.parametrize("name", ["guided", "nominal"])
def test_records_are_the_factors_of_what_was_executed(trials, name):
    """q_task after four actions, its bound from the pose before them, q_safe along them."""
    for trial in trials[name]:
        for k, record in enumerate(p for p in trial.certificate.policies if p.accepted):
            poses = trial.poses[4 * k : 4 * k + 5]
            assert record.bound == pytest.approx(q_task(poses[0]) - 0.05, abs=1e-3)
            if len(poses) == 5:  # else the trial ended within them
                assert record.q_task == pytest.approx(q_task(poses[-1]), abs=1e-3)
                assert record.q_safe == pytest.approx(q_safe(trial.condition, poses[1:]), abs=1e-3)


def at_start(condition):
    """One trial at rest, padded to six robots, in float64."""
    contacts, robots = np.zeros((1, 6, 2)), len(condition.contacts)
    contacts[0, :robots] = condition.contacts
    pose, goal, rest = (np.array([p]) for p in (condition.plank, condition.goal, (0.0, 0.0, 0.0)))
    mask = np.arange(6)[None] < robots
    return BridgeCondition(pose, rest, goal, contacts, mask, np.zeros((1, 20, 3)))


def test_guided_and_nominal_begin_with_the_same_noise(guided, nominal, trials, conditions):
    """z(0) of trial, policy and draw: generated from it again, each gives the actions it executed."""
    for k, condition in enumerate(conditions):
        noise = initial_noise(SEED, np.array([k]), 0, 0)
        for name, generator in (("guided", guided), ("nominal", nominal)):
            drawn = generator.policies.batch(noise, at_start(condition))
            executed = trials[name][k].twists[:4]
            np.testing.assert_array_equal(drawn.twists[0, : len(executed)], executed)


def test_every_policy_is_conditioned_on_where_the_last_one_led(guided, trials, conditions):
    """Pose, motion, and the previous policy four actions later; at first at rest."""
    for k in (0, 2):
        trial, condition = trials["guided"][k], conditions[k]
        rounds = []
        guided.trials([condition], seed=SEED, first=k, on_round=rounds.append)
        previous = np.zeros((20, 3))
        for policy, one in enumerate(rounds):
            assert (one.policy, one.trials) == (policy, (k,))
            state = jax.tree.map(lambda leaf: leaf[0], one.condition)
            motion = trial.twists[4 * policy - 1] if policy else np.zeros(3)
            np.testing.assert_allclose(state.plank, trial.poses[4 * policy], atol=1e-9)
            np.testing.assert_allclose(state.twist, motion, atol=1e-12)
            np.testing.assert_allclose(state.goal, condition.goal)
            ahead = continuation(jnp.asarray(previous), jnp.asarray(motion))
            np.testing.assert_allclose(state.continuation, ahead, atol=1e-6)
            draw = trial.certificate.policies[policy].draws - 1
            noise = initial_noise(SEED, np.array([k]), policy, draw)
            previous = guided.policies.batch(noise, one.condition).twists[0]


def test_same_call_same_trials_to_the_bit(guided, nominal, trials, conditions):
    for name, generator in (("guided", guided), ("nominal", nominal)):
        (again,) = generator.trials(conditions[:1], seed=SEED)
        assert again.to_json() == trials[name][0].to_json()


def test_another_seed_is_another_trial(nominal, trials, conditions):
    other = nominal.trials(conditions[1:2], seed=SEED + 1, first=1)[0]
    assert np.abs(other.twists[:4] - trials["nominal"][1].twists[:4]).max() > 1e-4


def test_a_batch_of_trials_is_in_order_and_true(nominal, conditions):
    """Together they are padded to one size and run until the last one is over."""
    found = nominal.trials([*conditions, BROKEN], seed=SEED)
    assert [t.condition for t in found] == [*conditions, BROKEN]
    for trial in found:
        np.testing.assert_allclose(
            trial.poses, driven(trial.condition.plank, trial.twists), atol=1e-9
        )
        assert trial.success == (
            bool(bridging(trial.poses)[-1]) and safe(trial.condition, trial.twists)
        )


def test_a_blocked_team_stops_and_says_why(blocked):
    """The robots at the gap and the task ask for opposite things: no success, no claim, nothing broken."""
    assert not blocked.success
    assert not blocked.certificate.satisfied
    assert blocked.reason == blocked.certificate.reason
    assert "q_task" in blocked.reason or "q_safe" in blocked.reason
    assert "robot" in blocked.reason
    assert safe(BLOCKED, blocked.twists)
    assert blocked.certificate.min_margin >= 0
    assert not bridging(blocked.poses).any()
    assert len(blocked.twists) > 0  # it went as far as it could


def test_the_policy_that_was_refused_is_on_record(blocked):
    *done, last = blocked.certificate.policies
    assert not last.accepted
    assert all(p.accepted for p in done)
    assert last.q_task > last.bound or last.q_safe > 0
    assert last.draws == blocked.certificate.draws == 2
    assert len(blocked.twists) == 4 * len(done)
    assert f"policy {len(done) + 1}" in blocked.reason


def test_a_start_that_is_broken_is_not_acted_on(guided, nominal):
    for generator in (guided, nominal):
        (trial,) = generator.trials([BROKEN], seed=SEED)
        assert trial.twists.shape == (0, 3)
        np.testing.assert_array_equal(trial.poses, [BROKEN.plank])
        assert not trial.success
        assert not trial.certificate.satisfied
        assert "robot 1 leaves the workspace" in trial.reason
        assert trial.certificate.min_margin < 0


def test_a_start_that_bridges_needs_no_action(guided):
    (trial,) = guided.trials([BRIDGED], seed=SEED)
    assert trial.twists.shape == (0, 3)
    assert trial.success
    assert trial.certificate.satisfied
    assert trial.certificate.policies == ()


def runaway(field, speed):
    """The field with an output of `speed` everywhere."""
    still = jax.tree.map(jnp.zeros_like, field)
    return eqx.tree_at(lambda f: f.exit.bias, still, jnp.full_like(field.exit.bias, speed))


@pytest.mark.parametrize("speed", [math.nan, math.inf, 1e30])
def test_a_diverging_field_is_said_to_diverge(nominal, field, conditions, speed):
    """Without a claim, without actions, in finite numbers."""
    generator = BridgeGenerator(runaway(field, speed))
    (trial,) = generator.trials(conditions[:1], seed=SEED)
    assert not trial.success
    assert not trial.certificate.satisfied
    assert "diverged" in trial.reason
    assert trial.twists.shape == (0, 3)
    assert trial.certificate.draws == 1  # without guidance there is no second draw
    assert all(np.isfinite([p.q_task, p.bound, p.q_safe]).all() for p in trial.certificate.policies)


def test_nothing_asked_for_nothing_made(nominal):
    assert nominal.trials([]) == []


@pytest.mark.parametrize("limit", [0, -1])
def test_at_least_one_draw(guided, conditions, limit):
    with pytest.raises(ValueError, match="max_draws"):
        guided.trials(conditions[:1], max_draws=limit)


def test_a_policy_refused_again_and_again_is_drawn_with_finer_steps(field, conditions, monkeypatch):
    generator = BridgeGenerator(field, bridge_guidance(field.scales), steps=6)
    coarse, made, asked = generator.policies, PolicyGenerator.batch, []

    def batch(policies, noise, condition):
        """What coarse steps make, which passes its check only where fine ones were asked for."""
        asked.append(len(policies.grid) - 1)
        found = made(coarse, noise, condition)
        return found if asked[-1] == 24 else found._replace(q_safe=found.q_safe + 100.0)

    monkeypatch.setattr(PolicyGenerator, "batch", batch)
    (trial,) = generator.trials(conditions[:1], seed=SEED, max_draws=8)
    first = trial.certificate.policies[0]
    assert first.accepted
    assert first.draws == 5
    assert asked[:5] == [6, 6, 6, 6, 24]
