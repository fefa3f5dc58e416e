"""Rows of shared requirements: their sum, their offsets, whom they touch."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shared_cases import (
    AGENTS,
    BELOW,
    FACTORS,
    GAINS,
    NEAR,
    bounds_by_hand,
    cases,
    factors_by_hand,
    guidance,
)

from deggflow import DecoupledGuidance, generate
from deggflow.guidance import (
    Fixed,
    Own,
    Pooled,
    Recovering,
    SharedFactor,
    SharedRequirements,
)

SHARES = np.array([[0.2, 0.3, 0.5, 0.0, 0.0], [0.0, 0.5, 0.25, 0.25, 0.0]])


class Moment(NamedTuple):
    """The guidance at random states, tau and drifts; slopes by central differences of the factors."""

    ell: np.ndarray
    b: np.ndarray
    correction: np.ndarray
    report: object
    slope: np.ndarray  # dq/dtau along drift + correction
    free: np.ndarray  # dq/dtau along the drift alone
    dbeta: np.ndarray
    room: np.ndarray  # q - beta
    changed: np.ndarray  # correction where another agent has another drift


# Allocations of the two factors, and whether the control maps are heterogeneous, else the identity.
ALLOCATIONS = {
    "pooled": (lambda: [Pooled()] * 2, True),
    "own": (lambda: [Own()] * 2, False),
    "fixed": (lambda: [Fixed(jnp.asarray(weight)) for weight in SHARES], False),
}


@cache
def moments(name, count=60):
    allocations, mapped = ALLOCATIONS[name]
    start, case = cases(count, 5)
    rng = np.random.default_rng(6)
    z = start + rng.normal(size=start.shape)
    drift, times = 3 * rng.normal(size=start.shape), rng.uniform(0.01, 0.99, count)
    other = drift.copy()
    other[:, 1] += 1.0

    @jax.jit
    @jax.vmap
    def at(z0, z, tau, drift, condition):
        guide = guidance(allocations(), mapped)
        state = guide.init(z0, condition)
        rows = guide.rows(state, tau, z, drift, condition)
        return rows.ell, rows.b, *guide(state, tau, z, drift, condition)[1:]

    def evaluated(drift):
        inputs = jax.tree.map(jnp.asarray, (start, z, times, drift, case))
        return jax.tree.map(np.asarray, at(*inputs))

    with jax.enable_x64(True):
        ell, b, correction, report = evaluated(drift)
        changed = evaluated(other)[2]

    def q(s, velocity):
        return each(times + s, z + s * velocity, lambda k: jax.tree.map(lambda leaf: leaf[k], case))

    def each(tau, z, of):
        return np.array(
            [factors_by_hand(tau[k : k + 1], z[k : k + 1], of(k))[0] for k in range(count)]
        )

    first = each(0 * times, start, lambda k: jax.tree.map(lambda leaf: leaf[k], case))

    def beta(s):
        return np.array([bounds_by_hand(times[k : k + 1] + s, first[k])[0] for k in range(count)])

    def difference(of, h=1e-6):
        return (of(h) - of(-h)) / (2 * h)

    return Moment(
        ell,
        b,
        correction,
        report,
        difference(lambda s: q(s, drift + correction)),
        difference(lambda s: q(s, drift)),
        difference(beta),
        q(0.0, drift) - beta(0.0),
        changed,
    )


@pytest.mark.parametrize("name", ALLOCATIONS)
def test_rows_together_imply_the_decay_of_the_factor(name):
    """dq/dtau <= dbeta/dtau - alpha(q - beta) along drift and correction (paper, eqn:app_SE_global_decay)."""
    one = moments(name)
    # Inputs of another order of magnitude are those of rows that are nearly opposed, or nearly zero.
    good = (
        ~one.report.qp_infeasible.any(1)
        & one.report.row_feasible.all((1, 2))
        & (one.report.input_norm.max(1) < 1e3)
    )
    assert good.sum() >= 20
    limit = one.dbeta - GAINS * one.room
    assert np.all((one.slope - limit)[good] <= 1e-4)
    assert np.mean(one.free[good] > limit[good]) > 0.2  # the drift alone does not


@pytest.mark.parametrize("name", ALLOCATIONS)
def test_offsets_of_a_factor_add_up(name):
    """sum_i b_i = grad q . f + dq/dtau - dbeta/dtau + alpha(q - beta), partial tau of q included."""
    one = moments(name)
    np.testing.assert_allclose(one.b.sum(-1), one.free - one.dbeta + GAINS * one.room, atol=1e-5)


@pytest.mark.parametrize("name", ["pooled", "own"])
def test_rows_of_agents_outside_a_factor_are_zero(name):
    one = moments(name)
    outside = np.ones((2, AGENTS), bool)
    outside[0, NEAR], outside[1, BELOW] = False, False
    assert np.all(one.ell[:, outside] == 0)
    assert np.all(one.b[:, outside] == 0)
    assert np.all(one.correction[:, 4] == 0)


def test_incidence_alone_decides_who_acts():
    """Though the second agent could bring the factor down as well, and is drawn in no factor."""
    factor = SharedFactor(
        lambda tau, z, condition: jnp.sum(z), incidence=lambda c: jnp.array([True, False])
    )
    requirements = SharedRequirements((factor,))

    @jax.jit
    def at(z, drift):
        guide, tau = DecoupledGuidance((requirements,)), jnp.asarray(0.5)
        state = guide.init(z, None)
        rows = guide.rows(state, tau, z, drift, None)
        return rows.ell, rows.b, guide(state, tau, z, drift, None)[1]

    ell, b, u = at(jnp.ones((2, 2)), jnp.array([[1.0, 1.0], [0.0, 0.0]]))
    assert np.all(ell[:, 1] == 0)
    assert np.all(b[:, 1] == 0)
    assert np.all(u[1] == 0)
    assert np.all(u[0] < 0)


@pytest.mark.parametrize("name", ALLOCATIONS)
def test_an_agents_input_knows_no_other_agents_drift(name):
    """Decoupled: with another drift of agent 1, the others' inputs are the same to the bit."""
    one = moments(name)
    others = np.arange(AGENTS) != 1
    np.testing.assert_array_equal(one.changed[:, others], one.correction[:, others])
    assert np.mean(np.any(one.changed[:, 1] != one.correction[:, 1], axis=-1)) > 0.5


def test_one_requirement_stated_twice_asks_for_the_same_input():
    """eta = 1 and d = l: the proposition's conditions hold; u_i = -max(b_i, 0) l_i / |l_i|^2."""
    start, case = cases(24, 2)
    twice = SharedRequirements((FACTORS[0], replace(FACTORS[0], name="again")))

    @jax.jit
    @jax.vmap
    def at(z, condition):
        guide, tau = DecoupledGuidance((twice,)), jnp.asarray(0.4)
        state, drift = guide.init(z, condition), 3.0 * jnp.sin(5.0 * z)
        rows = guide.rows(state, tau, z, drift, condition)
        return rows.ell[0], rows.b[0], *guide(state, tau, z, drift, condition)[1:]

    ell, b, u, report = at(*jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (start, case)))
    assert not report.qp_infeasible.any()
    square = np.where(np.sum(ell**2, -1) > 0, np.sum(ell**2, -1), 1.0)
    expected = -np.maximum(b, 0)[..., None] * ell / square[..., None]
    np.testing.assert_allclose(u, expected, atol=1e-4 * np.abs(expected).max())


def test_a_recovering_alpha_is_of_extended_class_k():
    """Zero at zero, increasing, and alpha(s) = s where q is below its bound."""
    alpha = Recovering(30.0)
    s = np.linspace(-2, 2, 101)
    value = np.asarray(jax.vmap(alpha)(jnp.asarray(s)))
    assert alpha(jnp.zeros(())) == 0
    assert np.all(np.diff(value) > 0)
    np.testing.assert_allclose(value[s <= 0], s[s <= 0], atol=1e-6)
    np.testing.assert_allclose(value[s > 0], 30 * s[s > 0], rtol=1e-5)


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan")])
def test_a_gain_that_is_not_positive_is_refused(gain):
    with pytest.raises(ValueError, match=f"`gain` must be positive.* got {gain}"):
        Recovering(gain)


def test_a_step_may_use_up_the_buffer_on_the_whole_way_down():
    """Explicit steps lag behind a bound that falls ever faster: the buffer, not the end value alone, pays for that."""
    factor = SharedFactor(
        lambda tau, z, condition: (jnp.mean(z[:, 0]) ** 2 / 0.05**2 - 1) / 2,
        alpha=Recovering(40.0),
        buffer=0.02,
    )
    guide = DecoupledGuidance((SharedRequirements((factor,)),))
    made = jax.jit(lambda z0: generate(lambda tau, z, condition: 0 * z, guide, z0, None))(
        jnp.array([[0.25, 0.0], [0.25, 0.1]])
    )
    beta = 0.02 + 0.02 + 12.0  # slack and buffer above q(z(0))
    tau = np.asarray(made.trace.tau)
    profile = 1 - 10 * tau**3 + 15 * tau**4 - 6 * tau**5
    np.testing.assert_allclose(made.trace.limit[:, 0], beta * profile, atol=1e-4)
    assert np.all(made.trace.value <= made.trace.limit)
    assert np.any(made.trace.value > made.trace.bound)  # and some does
    assert (made.work.refused_steps, made.work.forced_steps) == (0, 0)


def test_a_gradient_that_is_not_a_number_stays_with_its_factor():
    """sqrt at zero: its derivative is infinite, and zero times that is not a number."""
    sharp = SharedFactor(lambda tau, z, condition: jnp.sqrt(z[0, 0]), name="sharp")
    smooth = SharedFactor(lambda tau, z, condition: z[0, 0] + z[1, 1], name="smooth")
    guide = DecoupledGuidance((SharedRequirements((sharp, smooth)),))
    z = jnp.zeros((2, 2))

    @jax.jit
    def rows(z):
        state = guide.init(z, None)
        return guide.rows(state, jnp.zeros(()), z, jnp.ones_like(z), None).ell

    bad, good = np.asarray(rows(z))
    assert not np.all(np.isfinite(bad))
    np.testing.assert_array_equal(good, [[1.0, 0.0], [0.0, 1.0]])
