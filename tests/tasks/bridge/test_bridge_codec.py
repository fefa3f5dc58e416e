"""Encoder and decoder of motion policies: inverses on the splines' span, a projection beyond it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.bridge.codec import (
    continuation,
    decode,
    decode_twists,
    encode,
    executed_twists,
    spline_coefficients,
    spline_matrix,
    team_shares,
    team_twist,
)
from deggflow.tasks.bridge.condition import BridgeCondition, Scales
from deggflow.tasks.bridge.world import EXECUTED

T, K, AGENTS = 20, 8, 6
SCALES = Scales(eta=tuple(np.random.default_rng(0).uniform(0.05, 2.0, 3 * K).tolist()))


def random_state(seed, robots):
    """A team on both edges with a continuation; noise stands in the padding."""
    rng = np.random.default_rng([seed, robots])
    contacts = rng.normal(size=(AGENTS, 2))
    contacts[:robots, 0] = rng.uniform(-2.65, 2.65, robots)
    contacts[:robots, 1] = 0.36 * np.resize([1, -1], robots)
    ahead = rng.normal(size=(T, 3)) * 0.3
    zero = np.zeros(3)
    return BridgeCondition(zero, zero, zero, contacts, np.arange(AGENTS) < robots, ahead)


def double(function, *arguments):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, function(*jax.tree.map(jnp.asarray, arguments)))


decoded = jax.jit(lambda z, c: (decode(z, c, SCALES), decode_twists(z, c, SCALES)))
encoded = jax.jit(lambda v, c: encode(v, c, SCALES))
STATES = [random_state(1, 2), random_state(2, 4), random_state(3, 6)]


def jacobian(r):
    """J_B(r) = [I_2, r_perp]."""
    return np.array([[1.0, 0.0, -r[1]], [0.0, 1.0, r[0]]])


def velocities(twists, state):
    """c_{i,t} = J_B(r_i) xi_t."""
    return np.stack([twists @ jacobian(r).T for r in state.contacts])


def test_splines_are_a_clamped_cubic_partition_of_unity():
    basis = spline_matrix()
    assert basis.shape == (T, K)
    assert np.all(basis >= 0)
    np.testing.assert_allclose(basis.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(basis[[0, -1]], np.eye(K)[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(basis[::-1, ::-1], basis, atol=1e-12)
    assert np.linalg.matrix_rank(basis) == K
    assert np.count_nonzero(basis > 1e-12, axis=1).max() <= 4


def test_splines_reproduce_cubics():
    """A cubic lies in their span: what cubic splines are for."""
    tau = np.linspace(0, 1, T)
    for power in range(4):
        fit = np.linalg.lstsq(spline_matrix(), tau**power, rcond=None)[0]
        np.testing.assert_allclose(spline_matrix() @ fit, tau**power, atol=1e-12)


@pytest.mark.parametrize("state", STATES)
def test_decoder_is_the_papers(state):
    """xi_t = xi_bar_t + sum_k B_tk G^-1 sum_i M_i eta_ik, c_it = J_B(r_i) xi_t."""
    z = np.random.default_rng(5).normal(size=(AGENTS, 3 * K))
    found, twists = double(decoded, z, state)
    g, pull = np.zeros((3, 3)), np.zeros((K, 3))
    for i in range(int(state.mask.sum())):
        m = jacobian(state.contacts[i]).T @ jacobian(state.contacts[i])
        g += m
        for k in range(K):
            pull[k] += m @ (z[i] * SCALES.eta)[3 * k : 3 * k + 3]
    team = np.linalg.solve(g, pull.T).T
    expected = state.continuation.copy()
    for t in range(T):
        for k in range(K):
            expected[t] += spline_matrix()[t, k] * team[k]
    np.testing.assert_allclose(twists, expected, atol=1e-10)
    np.testing.assert_allclose(found, velocities(expected, state), atol=1e-10)


@pytest.mark.parametrize("state", STATES)
def test_absent_robots_do_not_count(state):
    rng = np.random.default_rng(6)
    z, elsewhere = rng.normal(size=(2, AGENTS, 3 * K))
    _, twists = double(decoded, z, state)
    other = np.where(state.mask[:, None], z, elsewhere)
    moved = np.where(state.mask[:, None], state.contacts, rng.normal(size=(AGENTS, 2)))
    np.testing.assert_allclose(double(decoded, other, state._replace(contacts=moved))[1], twists)


@pytest.mark.parametrize("state", STATES)
def test_encoding_inverts_decoding_on_the_splines_span(state):
    rng = np.random.default_rng(7)
    twists = state.continuation + spline_matrix() @ rng.normal(size=(K, 3))
    z = double(encoded, velocities(twists, state), state)
    np.testing.assert_allclose(double(decoded, z, state)[1], twists, atol=1e-9)
    assert np.all(z == z[0])  # the same coefficients for every robot


@pytest.mark.parametrize("state", STATES)
def test_decoding_then_encoding_is_a_projection(state):
    """z changes, as robots only agree on the team's part; the twists it stands for do not."""
    z = np.random.default_rng(8).normal(size=(AGENTS, 3 * K))
    found, twists = double(decoded, z, state)
    once = double(encoded, found, state)
    again_found, again = double(decoded, once, state)
    np.testing.assert_allclose(again, twists, atol=1e-9)
    np.testing.assert_allclose(double(encoded, again_found, state), once, atol=1e-9)


@pytest.mark.parametrize("state", STATES)
def test_beyond_the_span_the_encoder_is_least_squares(state):
    """What is left over is orthogonal to every spline."""
    twists = np.random.default_rng(9).normal(size=(T, 3))
    z = double(encoded, velocities(twists, state), state)
    rest = twists - double(decoded, z, state)[1]
    np.testing.assert_allclose(spline_matrix().T @ rest, 0.0, atol=1e-9)
    assert np.abs(rest).max() > 0.01


def test_spline_coefficients_are_least_squares():
    sequence = np.random.default_rng(10).normal(size=(5, T, 3))
    for one, found in zip(sequence, double(spline_coefficients, sequence), strict=True):
        expected = np.linalg.lstsq(spline_matrix(), one, rcond=None)[0]
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("state", STATES)
def test_the_teams_twist_is_least_squares_over_all_robots(state):
    """From velocities that fit no rigid motion."""
    robots = int(state.mask.sum())
    given = np.random.default_rng(11).normal(size=(AGENTS, T, 2))
    stacked = np.concatenate([jacobian(r) for r in state.contacts[:robots]])
    pulled = np.concatenate([given[i].T for i in range(robots)])
    expected = np.linalg.lstsq(stacked, pulled, rcond=None)[0].T
    found = double(team_twist, given, state.contacts, state.mask)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("state", STATES)
def test_the_robots_shares_add_up_to_the_identity(state):
    shares = double(team_shares, state.contacts, state.mask)
    np.testing.assert_allclose(shares.sum(axis=0), np.eye(3), atol=1e-10)
    assert np.all(shares[~state.mask] == 0)


@pytest.mark.parametrize("state", STATES)
def test_executed_twists_are_a_prefix(state):
    z = np.random.default_rng(12).normal(size=(AGENTS, 3 * K))
    part = double(lambda z, c: executed_twists(z, c, SCALES), z, state)
    np.testing.assert_allclose(part, double(decoded, z, state)[1][:EXECUTED], atol=1e-12)


def test_continuation_is_the_previous_policy_four_actions_later():
    """Its last value repeated; its first five values strictly between current motion and what is left."""
    rng = np.random.default_rng(13)
    previous, current = rng.normal(size=(T, 3)), rng.normal(size=3)
    found = double(continuation, previous, current)
    shifted = np.concatenate([previous[4:], np.repeat(previous[-1:], 4, axis=0)])
    np.testing.assert_allclose(found[5:], shifted[5:], atol=1e-12)
    part = (found[:5] - current) / (shifted[:5] - current)
    np.testing.assert_allclose(part, np.repeat(part[:, :1], 3, axis=1), atol=1e-9)
    assert np.all((part > 0) & (part < 1))
    assert np.all(np.diff(part[:, 0]) > 0)


def test_continuation_of_a_plan_that_goes_on_as_it_was():
    """Where the current motion is what is planned throughout, nothing changes; at rest all stays zero."""
    twist = np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(
        double(continuation, np.tile(twist, (T, 1)), twist), np.tile(twist, (T, 1)), atol=1e-12
    )
    assert not np.any(double(continuation, np.zeros((T, 3)), np.zeros(3)))
    batch = double(continuation, np.zeros((3, T, 3)), np.ones((3, 3)))
    np.testing.assert_allclose(batch, np.tile(batch[:1], (3, 1, 1)))
