"""The bridge's requirements and the policies they guide: values, bounds and decay worked out a second time."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from policy_cases import AGENTS, SCALES, K, T, at_rest, decoded, random_state

from deggflow import AfterPrediction, Extrapolated, ExtrapolatedEndpoint
from deggflow.tasks.bridge.condition import BridgeCondition, take
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.policies import Policies, PolicyGenerator, initial_noise, rounded
from deggflow.tasks.bridge.requirements import (
    bridge_guidance,
    bridge_requirements,
    final_values,
)

DT = 0.2


def stacked(states):
    return BridgeCondition(*(np.stack(leaves) for leaves in zip(*states, strict=True)))


def log_sum_exp(exponents, sharpness):
    top = max(exponents)
    return (top + math.log(sum(math.exp(e - top) for e in exponents))) / sharpness


def soft(x):
    return math.sqrt(x * x + 1e-12)


def q_task(pose):
    """Paper, App. on Task 1; the remaining margins are the plank's to both sides."""
    x, y, theta = pose
    cos, sin = soft(math.cos(theta)), soft(math.sin(theta))
    reach, side = (5.8 * cos + 0.72 * sin) / 2, (5.8 * sin + 0.72 * cos) / 2
    way = (2.9 - 0.16 - 0.075) * cos
    support = [-x + reach - 0.55, x + reach - 2.55]
    others = [-x + way - 0.05, x + way - 2.05, 3 - y - side, y - side + 3]
    return log_sum_exp([-80 * m / 0.55 for m in support] + [-80 * m / 0.2 for m in others], 80)


def q_safe(poses, contacts):
    """Buffers of 0.2 m and 0.1 m; support on one side by a smooth maximum of width 0.02 m."""
    margins = []
    for x, y, theta in poses:
        cos, sin = soft(math.cos(theta)), soft(math.sin(theta))
        reach, side = (5.8 * cos + 0.72 * sin) / 2, (5.8 * sin + 0.72 * cos) / 2
        one, two = -x + reach - 0.55, x + reach - 2.55
        width = math.hypot(one - two, 0.02)
        margins += [2.8 - y - side, y - side + 2.8, (one + two + width - 0.02) / 2]
        for r in contacts:
            place = complex(x, y) + np.exp(1j * theta) * complex(r[0], math.copysign(0.52, r[1]))
            margins += [-0.26 - place.real, 2.74 - place.imag, place.imag + 2.74]
    return log_sum_exp([-60 * m / 0.1 for m in margins], 60)


def driven(pose, twists):
    """Poses after each action, by chords of circles in complex numbers."""
    place, theta, poses = complex(pose[0], pose[1]), pose[2], []
    for v1, v2, omega in twists:
        angle = DT * omega
        chord = np.expm1(1j * angle) / (1j * angle) if angle else 1.0
        place, theta = place + np.exp(1j * theta) * chord * complex(v1, v2) * DT, theta + angle
        poses.append((place.real, place.imag, theta))
    return poses


def factors(twists, state):
    poses = driven(state.plank, twists[:4])
    return q_task(poses[-1]), q_safe(poses, state.contacts[state.mask])


def fastest(twists, state):
    """Of each contact point in the first four actions, m/s; absent robots stand still."""
    v, turn = twists[:4, 0] + 1j * twists[:4, 1], 1j * twists[:4, 2]
    places = state.contacts[:, 0] + 1j * state.contacts[:, 1]
    return np.abs(v[:, None] + turn[:, None] * places).max(axis=0) * state.mask


def on_device(tree):
    return jax.tree.map(jnp.asarray, tree)


ends = jax.jit(lambda z, condition: final_values(z, condition, SCALES))
STATES = [random_state(robots, seed) for seed, robots in enumerate((2, 4, 5, 6, 6))]


@pytest.mark.parametrize("state", STATES)
def test_factors_are_those_of_the_decoded_motion(state):
    z = np.random.default_rng(1).normal(size=(AGENTS, 3 * K))
    with jax.enable_x64(True):
        found = np.asarray(ends(jnp.asarray(z), on_device(state)))
    task, safe = factors(decoded(z, state, SCALES), state)
    np.testing.assert_allclose(found, [task, q_task(state.plank) - 0.05, safe], atol=1e-9)


def test_the_factors_are_named():
    names = "q_task", "q_safe"
    assert bridge_requirements(SCALES).names == bridge_guidance(SCALES).names == names
    assert bridge_guidance(SCALES, speed_limit=0.3).names == (*names, "speed")


@pytest.fixture(scope="module")
def field():
    return load_field()


@pytest.fixture(scope="module")
def generators(field):
    return {
        "guided": PolicyGenerator(field, bridge_guidance(field.scales)),
        "nominal": PolicyGenerator(field),
    }


BATCH = stacked([at_rest(4 + k % 3, 20 + k) for k in range(9)])
NOISE = initial_noise(5, np.arange(9), 0, 0)


@pytest.fixture(scope="module")
def policies(generators):
    """Guided ones in batches of one, as in other tests: one compiled program."""
    guided = [
        generators["guided"].batch(NOISE[k : k + 1], take(BATCH, slice(k, k + 1))) for k in range(9)
    ]
    *arrays, summaries, names, _ = zip(*guided, strict=True)
    summary = jax.tree.map(lambda *leaves: np.concatenate(leaves), *summaries)
    together = Policies(*map(np.concatenate, arrays), summary, names[0])
    return {"guided": together, "nominal": generators["nominal"].batch(NOISE, BATCH)}


@pytest.mark.parametrize("name", ["guided", "nominal"])
def test_reported_factors_are_those_of_the_twists(policies, name):
    """In float64, from the poses that the first four actions lead to."""
    found = policies[name]
    assert found.twists.shape == (9, T, 3)
    for k in range(9):
        state = take(BATCH, k)
        task, safe = factors(found.twists[k], state)
        assert found.q_task[k] == pytest.approx(task, abs=1e-8)
        assert found.q_safe[k] == pytest.approx(safe, abs=1e-8)
        assert found.bound[k] == pytest.approx(q_task(state.plank) - 0.05, abs=1e-8)
        np.testing.assert_allclose(found.speed[k], fastest(found.twists[k], state), atol=1e-9)


def test_guided_policies_end_below_their_bounds(policies):
    """All of them, with progress where the nominal ones from the same z(0) may miss it."""
    guided, nominal = policies["guided"], policies["nominal"]
    assert np.all(guided.q_task <= guided.bound)
    assert np.all(guided.q_safe <= 0)
    assert not any(guided.infeasible(k).any() for k in range(9))
    input_norm = guided.summary.largest_input_norm
    assert np.isfinite(input_norm).all()
    assert not nominal.summary.largest_input_norm.any()
    met = (nominal.q_task <= nominal.bound) & (nominal.q_safe <= 0)
    # Guidance that is not needed changes little, and any change shows in the input.
    changed = np.abs(guided.twists - nominal.twists).max((1, 2))
    assert np.all(changed[input_norm.max(1) == 0] <= 1e-5)
    assert np.all(changed[~met] > 1e-4)


def test_same_call_same_policies_to_the_bit(generators, policies):
    again = {
        "guided": generators["guided"].batch(NOISE[:1], take(BATCH, slice(0, 1))),
        "nominal": generators["nominal"].batch(NOISE, BATCH),
    }
    for name, found in again.items():
        assert found.names == policies[name].names
        leaves = (jax.tree.leaves(each._replace(names=())) for each in (found, policies[name]))
        for one, other in zip(*leaves, strict=True):
            np.testing.assert_array_equal(one, other[: len(one)])


def test_a_policy_does_not_depend_on_its_neighbours(generators, policies):
    """In another order, beside fewer others."""
    order = np.array([7, 2, 5])
    some = generators["nominal"].batch(NOISE[order], take(BATCH, order))
    np.testing.assert_allclose(some.twists, policies["nominal"].twists[order], atol=1e-5)


@pytest.fixture(scope="module")
def traces(generators, field):
    """Of some policies: the state, q(z(0)) and the trace."""
    out = []
    for k in (0, 1, 5):
        state = take(BATCH, k)
        start = factors(decoded(NOISE[k].astype(float), state, field.scales), state)
        trace = generators["guided"].trace(NOISE[k], state)
        out.append((state, np.array(start), jax.tree.map(np.asarray, trace)))
    return out


def test_bounds_are_the_papers(traces):
    """beta_task: max(q(z0) + 0.02, end + 0.02) down to q_cur - 0.05; beta_safe: q(z0) + 0.02 to 0."""
    for state, start, trace in traces:
        end = np.array([q_task(state.plank) - 0.05, 0.0])
        begin = np.array([max(start[0] + 0.02, end[0] + 0.02), start[1] + 0.02])
        tau = trace.tau[:, None].astype(float)
        expected = end + (begin - end) * (1 - 6 * tau**5 + 15 * tau**4 - 10 * tau**3)
        np.testing.assert_allclose(trace.bound, expected, rtol=1e-4, atol=1e-3)
        np.testing.assert_allclose(trace.value[0], start, rtol=1e-4, atol=1e-3)


def test_factors_stay_below_their_bounds_along_the_generation(traces):
    """thm:SE_finite_horizon for the trained field, up to the steps' own error; some robot has to act."""
    for state, _, trace in traces:
        assert trace.row_feasible.all()
        assert not trace.qp_infeasible.any()
        assert np.max(trace.value - trace.bound) <= 0.02
        assert np.all(trace.input_norm[:, ~state.mask] == 0)
    assert max(trace.input_norm.max() for *_, trace in traces) > 0


def test_noise_depends_on_seed_number_policy_and_draw_alone():
    whole = initial_noise(3, np.arange(20), 2, 1)
    np.testing.assert_array_equal(initial_noise(3, np.array([7]), 2, 1)[0], whole[7])
    np.testing.assert_array_equal(initial_noise(3, np.array([19, 4]), 2, 1), whole[[19, 4]])
    for other in ((4, 2, 1), (3, 1, 1), (3, 2, 0)):
        assert np.abs(initial_noise(other[0], np.arange(20), *other[1:]) - whole).min() > 0
    assert np.abs(initial_noise(3, np.arange(20), 1, 2) - whole).min() > 0


def test_noise_is_standard_normal():
    noise = initial_noise(0, np.arange(100), 0, 0).ravel()
    assert len(noise) == 100 * 8 * 24
    spread = 1 / math.sqrt(len(noise))
    assert abs(noise.mean()) < 4 * spread
    assert abs(noise.var() - 1) < 4 * math.sqrt(2) * spread
    assert abs(np.mean(noise**4) - 3) < 4 * math.sqrt(96) * spread


def test_policies_take_twelve_evaluations_by_default(field):
    usual = PolicyGenerator(field, bridge_guidance(field.scales))
    assert np.all(usual.batch(NOISE, BATCH).summary.work.field_evaluations == 12)
    assert PolicyGenerator(field, steps=4).drift.evaluations == 4


def test_guidance_after_a_prediction_moves_policies_less(field):
    noise = NOISE[:, : BATCH.mask.shape[1]]
    guidance, prediction = bridge_guidance(field.scales), ExtrapolatedEndpoint(12, power=1.5)
    nominal = PolicyGenerator(field).draw(noise, rounded(BATCH)).z
    during = PolicyGenerator(field, guidance).draw(noise, rounded(BATCH)).z
    late = PolicyGenerator(field, guidance, drift=AfterPrediction(prediction))
    found = late.batch(NOISE, BATCH)
    np.testing.assert_array_equal(found.summary.work.field_evaluations, 12)
    assert np.all(found.q_task <= found.bound)
    assert np.all(found.q_safe <= 0)
    after = late.draw(noise, rounded(BATCH)).z
    assert np.sum((after - nominal) ** 2) < np.sum((during - nominal) ** 2)
    still = PolicyGenerator(field, drift=AfterPrediction(prediction))
    assert still.drift == prediction  # nominal policies are on their way, not at its end


def test_few_evaluations_of_the_field_suffice(field):
    few = PolicyGenerator(field, bridge_guidance(field.scales), drift=Extrapolated(8, power=1.0))
    found = few.batch(NOISE, BATCH)
    np.testing.assert_array_equal(found.summary.work.field_evaluations, 8)
    assert np.all(found.q_task <= found.bound)
    assert np.all(found.q_safe <= 0)
