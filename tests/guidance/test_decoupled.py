import jax
import jax.numpy as jnp
import numpy as np

from deggflow import DecoupledGuidance, PrivateRequirement, hinge_violation

AGENTS, DIM, INPUTS = 3, 3, 2


def margins(z, condition):
    return jnp.concatenate([z[:, :1] - 0.5, 0.2 - z[:, 1:2]], axis=1)


def control(tau, z, condition):
    """A different, state-dependent map for every agent."""
    base = jax.random.normal(jax.random.key(0), (AGENTS, DIM, INPUTS))
    return base * (1 + 0.1 * jnp.tanh(z[:, :1, None]))


def test_rows_hold_for_any_control_map_and_metric(key):
    metric = jnp.array([[2.0, 0.5], [0.5, 1.0]])
    one = PrivateRequirement(violation=hinge_violation(margins, 0.05))
    guidance = DecoupledGuidance((one,), control=control, metric=metric)
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    tau = jnp.asarray(0.6)
    state = guidance.init(z, None)
    correction, report = guidance(state, tau, z, drift, None)
    g = control(tau, z, None)
    rows = one.rows(state[0], tau, z, drift, g, None)
    u = jnp.stack([jnp.linalg.lstsq(g[i], correction[i])[0] for i in range(AGENTS)])
    np.testing.assert_allclose(jnp.einsum("adm,am->ad", g, u), correction, atol=1e-3)
    slack = jnp.sum(rows.ell[0] * u, axis=1) + rows.b[0]
    assert jnp.all(slack[~report.infeasible] <= 1e-3 * (1 + jnp.abs(rows.b[0])))
    # Where an agent acts, its input is along H^-1 ell: no smaller one (in H) meets the row.
    for i in range(AGENTS):
        along = jnp.linalg.solve(metric, rows.ell[0, i])
        assert abs(along[0] * u[i, 1] - along[1] * u[i, 0]) <= 1e-2 * (1 + jnp.linalg.norm(u[i]))


def test_two_requirements_stand_in_one_generation(key):
    left = PrivateRequirement(violation=hinge_violation(lambda z, c: z[:, :1] - 0.5, 0.05))
    low = PrivateRequirement(violation=hinge_violation(lambda z, c: 0.2 - z[:, 1:2], 0.05))
    guidance = DecoupledGuidance((left, low))
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state = guidance.init(z, None)
    u, report = guidance(state, jnp.asarray(0.6), z, drift, None)
    assert report.value.shape == (2,)
    for one, own in zip(guidance.requirements, state, strict=True):
        rows = one.rows(own, jnp.asarray(0.6), z, drift, None, None)
        slack = jnp.sum(rows.ell[0] * u, axis=1) + rows.b[0]
        assert jnp.all(slack <= 1e-3 * (1 + jnp.abs(rows.b[0])))


def test_an_agents_input_does_not_use_anothers(key):
    """Each input is a function of states and the drift of its own agent."""
    guidance = DecoupledGuidance((PrivateRequirement(violation=hinge_violation(margins, 0.05)),))
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state = guidance.init(z, None)
    other = drift.at[1:].add(7.0)  # changes what the other agents do
    u, _ = guidance(state, jnp.asarray(0.5), z, drift, None)
    v, _ = guidance(state, jnp.asarray(0.5), z, other, None)
    np.testing.assert_array_equal(u[0], v[0])
