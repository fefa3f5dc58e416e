"""A robot's own speed limit beside what the team shares: its violation, guided trials, and limits too tight to keep."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from policy_cases import AGENTS, SCALES, K, T, decoded, random_state

from deggflow.guidance import hinge_violation
from deggflow.tasks.bridge.condition import BridgeCondition, TrialCondition
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.generator import BridgeGenerator
from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.bridge.requirements import SPEED_BUFFER, SpeedMargins, bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.verdict import contact_speeds

LIMIT, SEED = 0.3, 6  # m/s
STATES = [random_state(robots, seed) for seed, robots in enumerate((2, 3, 4, 5, 6, 6))]
RANDOM = 2 * np.random.default_rng(3).normal(size=(len(STATES), AGENTS, 3 * K))


def stacked(states):
    return BridgeCondition(*(np.stack(leaves) for leaves in zip(*states, strict=True)))


def speeds(twists, contacts):
    """|v + omega x r| of every action and contact point (m/s), in complex numbers."""
    v, turn = twists[:, 0] + 1j * twists[:, 1], 1j * twists[:, 2]
    places = np.asarray(contacts, float) @ [1, 1j]
    return np.abs(v[:, None] + turn[:, None] * places)


def by_hand(z, state, limit):
    """V_i from the definition: hinges over the four executed actions; nothing of robots that are not there."""
    out = np.zeros(AGENTS)
    there = np.flatnonzero(state.mask)
    moving = speeds(decoded(z, state, SCALES)[:4], state.contacts[there])
    margin = (limit**2 - moving**2) / (2 * limit)
    out[there] = (np.maximum(0.02 - margin, 0.0) ** 2).sum(axis=0) / 2
    return out


violation = hinge_violation(SpeedMargins(SCALES, LIMIT), SPEED_BUFFER)
violations = jax.jit(jax.vmap(violation))
gradients = jax.jit(jax.vmap(jax.grad(lambda z, c: jnp.sum(violation(z, c)))))


def in_double(function, z, states):
    with jax.enable_x64(True):
        return np.asarray(function(jnp.asarray(z), jax.tree.map(jnp.asarray, stacked(states))))


def test_the_violation_is_that_of_the_decoded_motion():
    found = in_double(violations, RANDOM, STATES)
    expected = [by_hand(z, state, LIMIT) for z, state in zip(RANDOM, STATES, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert (found > 0).any(axis=1).sum() >= 4


def test_robots_that_are_not_there_break_no_limit_and_change_nothing():
    """Whatever stands in the padding."""
    mask = np.stack([state.mask for state in STATES])
    found, slope = (in_double(f, RANDOM, STATES) for f in (violations, gradients))
    assert np.all(found[~mask] == 0)
    assert np.all(slope[~mask] == 0)
    other = np.where(mask[..., None], RANDOM, 1e3)
    np.testing.assert_array_equal(in_double(violations, other, STATES), found)


def test_the_gradient_is_that_of_finite_differences():
    """Of the definition, along random directions."""
    found = in_double(gradients, RANDOM, STATES)
    rng, step = np.random.default_rng(4), 1e-6
    for z, state, slope in zip(RANDOM, STATES, found, strict=True):
        for way in rng.normal(size=(4, AGENTS, 3 * K)):
            ends = [by_hand(z + sign * step * way, state, LIMIT).sum() for sign in (1, -1)]
            expected = (ends[0] - ends[1]) / (2 * step)
            assert np.sum(slope * way) == pytest.approx(expected, rel=1e-5, abs=1e-8)


def test_a_plank_at_rest_has_a_gradient():
    """Where every speed is zero."""
    still = [state._replace(continuation=np.zeros((T, 3))) for state in STATES]
    slope = in_double(gradients, np.zeros_like(RANDOM), still)
    np.testing.assert_array_equal(slope, 0.0)


def test_little_violation_implies_the_limit():
    """V <= delta^2 / 2 of the team leaves no contact point too fast, in float32, for states around the limit."""
    states, z = [], []
    for k, scale in enumerate(np.linspace(0.1, 1.5, 240)):
        states.append(STATES[k % len(STATES)])
        z.append(scale * np.random.default_rng(k).normal(size=(AGENTS, 3 * K)))
    z = np.array(z, np.float32)
    # JAX rounds float64 here, as it does for a compiled program.
    given = jax.tree.map(jnp.asarray, stacked(states))
    assert given.contacts.dtype == jnp.float32
    team = np.asarray(violations(jnp.asarray(z), given)).sum(axis=1)
    kept = [
        speeds(decoded(row, state, SCALES)[:4], state.contacts[state.mask]).max() <= LIMIT
        for row, state in zip(z.astype(float), states, strict=True)
    ]
    small = team <= SPEED_BUFFER**2 / 2
    assert 20 < small.sum() < 220
    assert np.all(np.array(kept)[small])
    assert not all(kept)


def test_contact_speeds_are_the_largest_of_each_point():
    twists = np.random.default_rng(5).normal(size=(7, 3))
    contacts = STATES[4].contacts
    np.testing.assert_allclose(
        contact_speeds(twists, contacts), speeds(twists, contacts).max(axis=0), atol=1e-12
    )
    assert not contact_speeds(twists[:0], contacts).any()


@pytest.fixture(scope="module")
def field():
    return load_field()


@pytest.fixture(scope="module")
def limited(field):
    return BridgeGenerator(
        field, bridge_guidance(field.scales, speed_limit=LIMIT), speed_limit=LIMIT
    )


@pytest.fixture(scope="module")
def conditions():
    return [random_conditions(4, 1, 40 + k)[0] for k in range(2)]


@pytest.fixture(scope="module")
def slow(limited, conditions):
    """In batches of one, as in other tests."""
    return [limited.trials([c], seed=SEED, first=k)[0] for k, c in enumerate(conditions)]


@pytest.fixture(scope="module")
def free(field, conditions):
    """Guided from the same starts and z(0), without a limit."""
    generator = BridgeGenerator(field, bridge_guidance(field.scales))
    return [generator.trials([c], seed=SEED, first=k)[0] for k, c in enumerate(conditions)]


def test_no_contact_point_is_faster_than_its_limit(slow, free):
    for trial in slow:
        assert trial.success
        assert trial.certificate.satisfied
        assert trial.certificate.speed_limit == LIMIT
        assert refutation(trial.to_json()) is None
        assert speeds(trial.twists, trial.condition.contacts).max() <= LIMIT
    for trial in free:
        assert trial.certificate.satisfied
        assert trial.certificate.speed_limit is None
        assert "speed_limit" not in trial.to_json()["certificate"]
        assert speeds(trial.twists, trial.condition.contacts).max() > LIMIT


def test_records_tell_the_speed_of_what_was_executed(slow, free):
    for trial in [*slow, *free]:
        moving = speeds(trial.twists, trial.condition.contacts)
        for k, record in enumerate(trial.certificate.policies):
            executed = moving[4 * k : 4 * k + 4]
            if len(executed) == 4:  # else the trial ended within them
                assert record.speed == pytest.approx(executed.max(), abs=1e-9)


def test_each_generation_is_on_record(slow, free):
    for trials, names in ((slow, ("q_task", "q_safe", "speed")), (free, ("q_task", "q_safe"))):
        for trial in trials:
            for record in trial.certificate.policies:
                made = record.generation
                assert tuple(each.name for each in made.requirements) == names
                assert made.steps >= 50
                assert made.requirements[0].value == pytest.approx(record.q_task, abs=1e-3)
                assert made.requirements[1].value == pytest.approx(record.q_safe, abs=1e-3)
                if made.hypotheses_hold:
                    assert all(each.excess <= 0 for each in made.requirements)


def test_the_oracle_refutes_a_certificate_whose_twists_exceed_its_limit(free):
    for trial in free:
        value = trial.to_json()
        assert refutation(value) is None
        fastest = speeds(trial.twists, trial.condition.contacts).max()
        value["certificate"]["speed_limit"] = fastest - 1e-6
        assert refutation(value) == f"a contact point moves at {fastest:.4f} m/s"
        value["certificate"]["speed_limit"] = fastest + 1e-6
        assert refutation(value) is None


def test_a_limit_that_is_not_kept_is_told_with_the_robot_and_its_speed(field, limited, conditions):
    """Guidance keeps another limit than the one that is asked for: the policies are checked, not trusted."""
    strict = BridgeGenerator(field, limited.policies.guidance, speed_limit=0.01)
    (trial,) = strict.trials(conditions[:1], seed=SEED, max_draws=2)
    assert not trial.success
    assert not trial.certificate.satisfied
    assert trial.twists.shape == (0, 3)
    (record,) = trial.certificate.policies
    assert not record.accepted
    assert record.draws == 2
    assert 0.01 < record.speed <= LIMIT
    found = [
        k for k in range(4) if f"robot {k + 1} would move at {record.speed:.3f} m/s" in trial.reason
    ]
    assert len(found) == 1


def test_the_fastest_robot_is_the_one_that_is_named(field, limited):
    """Of two at one place and one far from where the plank turns about."""
    condition = TrialCondition(
        (-3.2, 0.0, 0.5), (-0.3, 0.0, 0.0), ((-2.6, 0.36), (-2.6, -0.36), (-0.2, 0.36))
    )
    strict = BridgeGenerator(field, limited.policies.guidance, speed_limit=0.01)
    drawn = []
    batch = strict.policies.batch

    def look(noise, condition):
        drawn.append(batch(noise, condition))
        return drawn[-1]

    strict.policies.batch = look
    (trial,) = strict.trials([condition], seed=SEED, max_draws=1)
    moving = speeds(drawn[0].twists[0, :4], condition.contacts).max(axis=0)
    name = int(np.argmax(moving)) + 1
    assert math.isclose(moving[name - 1], trial.certificate.policies[0].speed, abs_tol=1e-9)
    assert f"robot {name} would move at {moving.max():.3f} m/s" in trial.reason
