"""The local QP by its KKT conditions, and against quadprog and linear programs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quadprog
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from deggflow.guidance import min_norm_input

SIZES = st.integers(1, 4)


def instance(seed, rows, inputs):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(inputs, inputs))
    metric = root @ root.T + 0.1 * np.eye(inputs)
    ell = rng.normal(size=(rows, inputs)) * 10.0 ** rng.uniform(-3, 3, (rows, 1))
    b = rng.normal(size=rows) * np.linalg.norm(ell, axis=1)
    return ell, b, metric


def solve(ell, b, metric):
    with jax.enable_x64(True):
        out = min_norm_input(jnp.asarray(ell), jnp.asarray(b), jnp.asarray(metric))
        return np.asarray(out.u), bool(out.feasible)


def kkt_residual(ell, b, metric, u):
    """Least residual of stationarity, over nonnegative multipliers of the rows that bind."""
    norm = np.linalg.norm(ell, axis=1)
    slack = (ell @ u + b) / norm
    assert np.all(slack <= 1e-9 * (1 + np.linalg.norm(u)))
    binding = slack > -1e-9 * (1 + np.linalg.norm(u))
    gradient = 2 * metric @ u
    if not binding.any():
        return np.linalg.norm(gradient)
    rows = (ell / norm[:, None])[binding]
    multipliers = np.linalg.lstsq(rows.T, -gradient, rcond=None)[0]
    assert np.all(multipliers >= -1e-7 * (1 + np.linalg.norm(gradient)))
    return np.linalg.norm(gradient + rows.T @ multipliers)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 2), SIZES)
def test_kkt_conditions_and_quadprog(seed, rows, inputs):
    if rows == 2 and inputs == 1:
        inputs = 2  # parallel rows have a test of their own
    ell, b, metric = instance(seed, rows, inputs)
    u, feasible = solve(ell, b, metric)
    assert feasible
    scale = 1 + np.linalg.norm(metric) * np.linalg.norm(u)
    assert kkt_residual(ell, b, metric, u) <= 1e-7 * scale
    norm = np.linalg.norm(ell, axis=1)
    other = quadprog.solve_qp(2 * metric, np.zeros(inputs), -(ell / norm[:, None]).T, b / norm)[0]
    assert u @ metric @ u == pytest.approx(other @ metric @ other, rel=1e-6, abs=1e-12)


def test_no_rows_no_input():
    u, feasible = min_norm_input(jnp.zeros((0, 3)), jnp.zeros(0))
    assert feasible
    assert jnp.array_equal(u, jnp.zeros(3))


def test_a_met_row_costs_nothing():
    u, feasible = min_norm_input(jnp.ones((2, 3)), jnp.array([-1.0, 0.0]))
    assert feasible
    assert jnp.array_equal(u, jnp.zeros(3))


@pytest.mark.parametrize("rows", [1, 2])
def test_a_row_that_no_input_changes_is_infeasible_if_it_must_be_met(rows):
    ell = jnp.eye(3)[:rows].at[0].set(0.0)
    must = jnp.full(rows, 0.5)
    u, feasible = min_norm_input(ell, must)
    assert not feasible
    assert jnp.all(jnp.isfinite(u))
    if rows == 2:
        assert ell[1] @ u + must[1] <= 1e-6  # the other row is met all the same
    assert min_norm_input(ell, -must).feasible


@pytest.mark.parametrize(
    ("b", "feasible"), [((1.0, -2.0), True), ((1.0, -1.0), True), ((1.0, -0.5), False)]
)
def test_opposed_rows_are_feasible_only_if_their_half_spaces_meet(b, feasible):
    ell = jnp.array([[1.0, 0.0], [-1.0, 0.0]])
    u, found = min_norm_input(ell, jnp.array(b))
    assert bool(found) == feasible
    if feasible:
        np.testing.assert_allclose(u, [-1.0, 0.0], atol=1e-6)


def test_equal_rows_need_the_larger_input():
    ell = jnp.array([[0.0, 2.0], [0.0, 2.0]])
    u, feasible = min_norm_input(ell, jnp.array([1.0, 3.0]))
    assert feasible
    np.testing.assert_allclose(u, [0.0, -1.5], atol=1e-6)


def test_gradients_are_finite_at_zero_rows():
    def effort(ell):
        return jnp.sum(min_norm_input(ell, jnp.ones(2)).u ** 2)

    assert jnp.all(jnp.isfinite(jax.grad(effort)(jnp.zeros((2, 3)))))


@pytest.mark.parametrize(
    ("rows", "inputs"), [(3, 1), (3, 2), (4, 3), (8, 3), (12, 3), (6, 4), (14, 3)]
)
def test_any_number_of_rows_by_kkt_or_by_a_linear_program(rows, inputs):
    """Either the KKT conditions hold, or a linear program finds no point either."""
    drawn = [instance(seed, rows, inputs) for seed in range(200)]
    ell, b, metric = (np.array(part) for part in zip(*drawn, strict=True))
    nearly = np.random.default_rng(0).normal(size=ell[::5, 0].shape)
    ell[::5, 1] = -ell[::5, 0] + 1e-4 * np.linalg.norm(ell[::5, :1], axis=-1) * nearly
    with jax.enable_x64(True):
        out = jax.jit(jax.vmap(min_norm_input))(*(jnp.asarray(a) for a in (ell, b, metric)))
    u, feasible = np.asarray(out.u), np.asarray(out.feasible)
    assert 0 < feasible.mean() < 1
    for k in range(len(drawn)):
        check_kkt_or_linear_program(ell[k], b[k], metric[k], u[k], feasible[k])


@pytest.mark.parametrize(("rows", "inputs"), [(5, 2), (7, 3), (12, 3), (5, 4)])
def test_rows_on_a_grid_that_meet_in_one_point_or_coincide(rows, inputs):
    """Small whole numbers: many rows are equal, opposed or pass through a common point, and sets just touch."""
    rng = np.random.default_rng(rows)
    ell = rng.integers(-1, 2, (300, rows, inputs)).astype(float)
    ell[..., 0] += 2.0 * (ell == 0).all(axis=-1)  # no row of zeros
    b = rng.integers(-2, 2, (300, rows)).astype(float)
    with jax.enable_x64(True):
        out = jax.jit(jax.vmap(min_norm_input))(jnp.asarray(ell), jnp.asarray(b))
    u, feasible = np.asarray(out.u), np.asarray(out.feasible)
    assert 0 < feasible.mean() < 1
    for k in range(len(ell)):
        check_kkt_or_linear_program(ell[k], b[k], np.eye(inputs), u[k], feasible[k])


@pytest.mark.rounding
def test_agents_of_samples_at_once_get_what_each_gets_alone():
    rng = np.random.default_rng(0)
    ell = jnp.asarray(rng.normal(size=(4, 5, 6, 3)), jnp.float32)
    b = jnp.asarray(
        rng.normal(size=(5, 4, 6)), jnp.float32
    )  # samples and agents the other way round
    both = jax.vmap(jax.vmap(min_norm_input), in_axes=(0, 1))(ell, b)
    for s in range(4):
        for i in range(5):
            alone = min_norm_input(ell[s, i], b[i, s])
            assert alone.feasible == both.feasible[s, i]
            np.testing.assert_allclose(both.u[s, i], alone.u, atol=1e-5)
    shared = jax.vmap(min_norm_input, in_axes=(None, 0))(
        ell[0, 0], b[:, 0]
    )  # the same rows for all
    np.testing.assert_allclose(shared.u[0], min_norm_input(ell[0, 0], b[0, 0]).u, atol=1e-5)


def check_kkt_or_linear_program(ell, b, metric, u, feasible):
    norm = np.linalg.norm(ell, axis=1)
    unit, distance = ell / norm[:, None], b / norm
    free = linprog(np.zeros(len(u)), unit, -distance, bounds=(None, None))
    assert feasible == (free.status == 0)
    if not feasible:
        return
    scale = 1 + np.linalg.norm(metric) * np.linalg.norm(u)
    gradient = 2 * metric @ u
    slack = unit @ u + distance
    assert np.all(slack <= 1e-8 * scale)
    binding = unit[slack > -1e-7 * scale]
    left = nnls(binding.T, -gradient)[1] if len(binding) else np.linalg.norm(gradient)
    assert left <= 1e-6 * scale


def test_three_rows_that_contradict_each_other_are_infeasible():
    """Half-planes around the origin that all point away from it."""
    angle = np.array([0.0, 2.1, 4.2])
    ell = np.stack([np.cos(angle), np.sin(angle)], -1)
    assert not solve(ell, np.ones(3), np.eye(2))[1]
    assert solve(ell[:2], np.ones(2), np.eye(2))[1]


def test_a_box_limits_each_entry_and_says_so():
    ell, b = jnp.array([[1.0, 1.0]]), jnp.array([1.0])
    free, boxed = min_norm_input(ell, b), min_norm_input(ell, b, box=0.6)
    np.testing.assert_allclose(boxed.u, free.u, atol=1e-6)
    assert boxed.feasible
    skew = jnp.array([[1.0, 0.2]])
    u, feasible = min_norm_input(skew, b, box=0.9)
    assert feasible
    np.testing.assert_allclose(u, [-0.9, -0.5], atol=1e-5)
    assert not min_norm_input(skew, b, box=0.5).feasible


def test_a_norm_limits_the_size_and_says_so():
    ell, b = jnp.array([[0.0, 1.0]]), jnp.array([2.0])
    assert min_norm_input(ell, b, norm=2.5).feasible
    u, feasible = min_norm_input(ell, b, norm=1.5)
    assert not feasible
    np.testing.assert_allclose(u, [0.0, -1.5], atol=1e-6)


def test_a_norm_that_is_just_reached_is_feasible():
    rng = np.random.default_rng(0)
    ell, b = jnp.asarray(rng.normal(size=(500, 1, 3)), jnp.float32), jnp.ones((500, 1), jnp.float32)
    length = np.linalg.norm(np.asarray(ell, np.float64), axis=-1)[:, 0]
    k = int(np.argmin(np.abs(length - 0.7)))
    for scale in (1.0, 1e-12, 1e12):
        norm = float(scale / length[k])
        assert min_norm_input(ell[k], scale * b[k], norm=norm).feasible
        assert not min_norm_input(ell[k], scale * b[k], norm=0.999 * norm).feasible
