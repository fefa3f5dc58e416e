import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import DecoupledGuidance, PrivateRequirement

AGENTS, DIM, INPUTS = 3, 3, 2


def margins(z, condition):
    return jnp.concatenate([z[:, :1] - 0.5, 0.2 - z[:, 1:2]], axis=1)


def control(tau, z, condition):
    """A different, state-dependent map for every agent."""
    base = jax.random.normal(jax.random.key(0), (AGENTS, DIM, INPUTS))
    return base * (1 + 0.1 * jnp.tanh(z[:, :1, None]))


def test_rows_hold_for_any_control_map_and_metric(key):
    metric = jnp.array([[2.0, 0.5], [0.5, 1.0]])
    one = PrivateRequirement(margins, 0.05)
    guidance = DecoupledGuidance((one,), control=control, metric=metric)
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    tau = jnp.asarray(0.6)
    state = guidance.init(z, None)
    _, correction, report = jax.jit(lambda z: guidance(state, tau, z, drift, None))(z)
    g = control(tau, z, None)
    rows = jax.jit(lambda z: guidance.rows(state, tau, z, drift, None))(z)
    u = jnp.stack([jnp.linalg.lstsq(g[i], correction[i])[0] for i in range(AGENTS)])
    np.testing.assert_allclose(jnp.einsum("adm,am->ad", g, u), correction, atol=1e-3)
    slack = jnp.sum(rows.ell[0] * u, axis=1) + rows.b[0]
    assert jnp.all(slack[~report.qp_infeasible] <= 1e-3 * (1 + jnp.abs(rows.b[0])))
    # Where an agent acts, its input is along H^-1 ell: no smaller one (in H) meets the row.
    for i in range(AGENTS):
        along = jnp.linalg.solve(metric, rows.ell[0, i])
        assert abs(along[0] * u[i, 1] - along[1] * u[i, 0]) <= 1e-2 * (1 + jnp.linalg.norm(u[i]))


def test_two_requirements_stand_in_one_generation(key):
    left = PrivateRequirement(lambda z, c: z[:, :1] - 0.5, 0.05, name="left")
    low = PrivateRequirement(lambda z, c: 0.2 - z[:, 1:2], 0.05, name="low")
    guidance = DecoupledGuidance((left, low))
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state = guidance.init(z, None)
    tau = jnp.asarray(0.6)
    _, u, report = jax.jit(lambda z: guidance(state, tau, z, drift, None))(z)
    assert report.value.shape == (2,)
    rows = jax.jit(lambda z: guidance.rows(state, tau, z, drift, None))(z)
    assert rows.b.shape == (2, AGENTS)
    assert not report.qp_infeasible.any()
    slack = jnp.sum(rows.ell * u[None], axis=2) + rows.b
    assert jnp.all(slack <= 1e-3 * (1 + jnp.abs(rows.b)))


def test_an_agents_input_does_not_use_anothers(key):
    """Each input is a function of states and the drift of its own agent."""
    guidance = DecoupledGuidance((PrivateRequirement(margins, 0.05),))
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state = guidance.init(z, None)
    other = drift.at[1:].add(7.0)  # changes what the other agents do
    _, u, _ = guidance(state, jnp.asarray(0.5), z, drift, None)
    _, v, _ = guidance(state, jnp.asarray(0.5), z, other, None)
    np.testing.assert_array_equal(u[0], v[0])


METRICS = np.array([[[2.0, 0.5], [0.5, 1.0]], [[1.0, 0.0], [0.0, 4.0]], [[0.5, -0.2], [-0.2, 1.0]]])


@functools.cache
def limited(box, norm, count=30):
    """Rows, inputs and who is reported, at random states of growing urgency."""
    one = PrivateRequirement(margins, 0.05)
    rng = np.random.default_rng(2)
    z, drift = rng.normal(size=(2, count, AGENTS, DIM))

    @jax.jit
    @jax.vmap
    def at(z, drift):
        guide = DecoupledGuidance((one,), plane, jnp.asarray(METRICS), box=box, norm=norm)
        state, tau = guide.init(z, None), jnp.asarray(0.5)
        rows = guide.rows(state, tau, z, drift, None)
        _, correction, report = guide(state, tau, z, drift, None)
        return rows.ell[0], rows.b[0], correction[:, :2], report.qp_infeasible, report.input_norm

    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, at(jnp.asarray(z), jnp.asarray(drift)))


def plane(tau, z, condition):
    """Inputs are of the first two coordinates, where the requirement is."""
    return jnp.broadcast_to(jnp.eye(DIM, INPUTS, dtype=z.dtype), (AGENTS, DIM, INPUTS))


def within(slack, b):
    return slack <= 1e-9 * (1 + np.abs(b))


def test_a_box_is_kept_and_reported_where_rows_ask_for_more():
    """One row and |u_k| <= box: it can be met if and only if b <= box |ell|_1."""
    box = 4.0
    ell, b, u, infeasible, _ = limited(box, None)
    np.testing.assert_array_equal(infeasible, b > box * np.abs(ell).sum(-1))
    assert 0.1 < infeasible.mean() < 0.9
    assert np.any(np.isclose(np.abs(u), box, rtol=1e-6).any(-1) & ~infeasible)  # it decides
    assert np.abs(u).max() <= box * (1 + 1e-9)
    assert np.all(within((ell * u).sum(-1) + b, b)[~infeasible])


def test_a_norm_limit_is_kept_and_reported_where_rows_ask_for_more():
    """One row and u @ H u <= norm^2, H_i of each agent: it can be met if and only if b <= norm |ell|_(H^-1)."""
    norm = 4.0
    ell, b, u, infeasible, input_norm = limited(None, norm)
    reach = np.sqrt(np.einsum("nai,aij,naj->na", ell, np.linalg.inv(METRICS), ell))
    np.testing.assert_array_equal(infeasible, b > norm * reach)
    assert 0.1 < infeasible.mean() < 0.9
    size = np.sqrt(np.einsum("nai,aij,naj->na", u, METRICS, u))
    assert size.max() <= norm * (1 + 1e-9)
    np.testing.assert_allclose(size[infeasible], norm, rtol=1e-9)  # as much as is allowed
    np.testing.assert_allclose(input_norm, np.linalg.norm(u, axis=-1), rtol=1e-9, atol=1e-12)
    assert np.all(within((ell * u).sum(-1) + b, b)[~infeasible])


@pytest.mark.parametrize("limit", ["box", "norm"])
def test_limits_that_are_not_reached_change_nothing(limit):
    free = limited(None, None)
    wide = limited(**{"box": None, "norm": None} | {limit: 1e6})
    assert not wide[3].any()
    np.testing.assert_allclose(wide[2], free[2], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("limit", ["box", "norm"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_that_are_not_positive_are_refused(limit, value):
    def guided():
        one = PrivateRequirement(margins, 0.05)
        guidance, z = DecoupledGuidance((one,), **{limit: value}), jnp.ones((AGENTS, DIM))
        return guidance(guidance.init(z, None), jnp.asarray(0.5), z, z, None)

    with pytest.raises(ValueError, match=f"`{limit}` must be positive.* got {value}"):
        guided()
