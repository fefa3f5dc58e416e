"""The local QP by its KKT conditions, against quadprog and linear programs, and in exact arithmetic."""

import subprocess
import sys
from fractions import Fraction
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quadprog
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from deggflow.guidance import min_norm_input
from deggflow.guidance.metric import check_metric
from deggflow.guidance.qp import check_limits

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


@pytest.mark.parametrize("limit", ["box", "norm"])
def test_limits_must_be_positive(limit):
    with pytest.raises(ValueError, match=f"`{limit}` must be positive"):
        min_norm_input(jnp.ones((1, 2)), jnp.ones(1), **{limit: 0.0})


def test_a_norm_that_is_just_reached_is_feasible():
    rng = np.random.default_rng(0)
    ell, b = jnp.asarray(rng.normal(size=(500, 1, 3)), jnp.float32), jnp.ones((500, 1), jnp.float32)
    length = np.linalg.norm(np.asarray(ell, np.float64), axis=-1)[:, 0]
    k = int(np.argmin(np.abs(length - 0.7)))
    for scale in (1.0, 1e-12, 1e12):
        norm = float(scale / length[k])
        assert min_norm_input(ell[k], scale * b[k], norm=norm).feasible
        assert not min_norm_input(ell[k], scale * b[k], norm=0.999 * norm).feasible


# Scales: what follows holds for every unit of the requirements and of the input.

TYPES = [np.float32, np.float64]
FEW_EPS = 16


@cache
def compiled(box=None):
    return jax.jit(jax.vmap(lambda ell, b: min_norm_input(ell, b, box=box)))


BATCH = 100  # instances at once, so that each shape is compiled once


def solve_all(ell, b, dtype, box=None):
    """Instances of one shape, in the precision that is asked for."""
    index = np.resize(np.arange(len(ell)), BATCH)
    with jax.enable_x64(dtype == np.float64):
        out = compiled(box)(jnp.asarray(ell[index], dtype), jnp.asarray(b[index], dtype))
    assert out.u.dtype == dtype
    return np.asarray(out.u)[: len(ell)], np.asarray(out.feasible)[: len(ell)]


def violation(ell, b, u):
    """Of every row, over its own |ell| |u| + |b|; in extended precision."""
    ell, b, u = (np.asarray(each, np.longdouble) for each in (ell, b, u))
    size = np.sqrt((ell**2).sum(-1)) * np.sqrt((u**2).sum(-1))[..., None] + np.abs(b)
    lack = np.einsum("...ri,...i->...r", ell, u) + b
    return lack / np.where(size > 0, size, 1.0)


def exactly_feasible(ell, b):
    """Fourier-Motzkin elimination in rational numbers."""
    rows = [[Fraction(float(x)) for x in (*e, c)] for e, c in zip(ell, b, strict=True)]
    for k in range(len(ell[0])):
        up = [row for row in rows if row[k] > 0]
        down = [row for row in rows if row[k] < 0]
        rows = [row for row in rows if row[k] == 0]
        rows += [[x / p[k] - y / q[k] for x, y in zip(p, q, strict=True)] for p in up for q in down]
    return all(row[-1] <= 0 for row in rows)


def scaled_instances(rng, rows, inputs, kind, count=60):
    """Rows and offsets of any scale; the row or its offset, each by itself or all at once."""
    ell, b = rng.normal(size=(count, rows, inputs)), rng.normal(size=(count, rows))
    if kind == "rows":
        size = 10.0 ** rng.uniform(-18, 18, (count, rows))
        return ell * size[..., None], b * size
    if kind == "all":
        return ell * 10.0 ** rng.uniform(-15, 15, (count, 1, 1)), b * 10.0 ** rng.uniform(
            -15, 15, (count, 1)
        )
    sparse = ell * (
        rng.random(ell.shape) < 0.5
    )  # small rows beside large ones that leave them alone
    return sparse, b * 10.0 ** rng.uniform(-10, 10, (count, rows))


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(1, 3), (2, 2), (2, 3), (3, 3), (5, 3), (3, 4)])
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["rows", "all", "mixed"]))
def test_feasible_means_met_and_infeasible_means_contradictory_at_every_scale(
    dtype, shape, seed, kind
):
    ell, b = scaled_instances(np.random.default_rng(seed), *shape, kind)
    ell, b = ell.astype(dtype), b.astype(dtype)
    u, feasible = solve_all(ell, b, dtype)
    assert np.isfinite(u).all()
    eps = np.finfo(dtype).eps
    assert np.all(violation(ell, b, u)[feasible] <= FEW_EPS * eps)
    for k in range(len(ell)):
        assert feasible[k] == exactly_feasible(ell[k], b[k])


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(1, 3), (2, 3), (3, 3), (3, 4)])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), of_rows=st.integers(-20, 20), of_input=st.integers(-15, 15))
def test_units_change_nothing(dtype, shape, seed, of_rows, of_input):
    """With rows in another unit u is the same; with the input in another one, u is in that."""
    rng = np.random.default_rng(seed)
    ell, b = rng.normal(size=(20, *shape)), rng.normal(size=(20, shape[0]))
    u, feasible = solve_all(ell, b, dtype)
    row, unit = 10.0**of_rows, 10.0**of_input
    scaled, still = solve_all(ell * row, b * row, dtype)
    assert np.array_equal(feasible, still)
    size = np.linalg.norm(u, axis=-1, keepdims=True)
    close = 2000 * np.finfo(dtype).eps * (1 + size) ** 2
    assert np.all(np.abs(scaled - u)[feasible] <= close[feasible])
    longer, still = solve_all(ell, b * unit, dtype)
    assert np.array_equal(feasible, still)
    assert np.all(np.abs(longer / unit - u)[feasible] <= close[feasible])


@pytest.mark.parametrize(("rows", "inputs"), [(4, 4), (4, 3)])
def test_many_rows_that_ask_for_little_are_met(rows, inputs):
    b = np.full(rows, 3e-7, np.float32)
    u, feasible = solve_all(np.eye(4, dtype=np.float32)[None, :rows, :inputs], b[None], np.float32)
    if inputs == 4:
        assert feasible[0]
        np.testing.assert_allclose(u[0], -b, rtol=1e-6)
    else:
        assert not feasible[0]  # the last row has no input left


@pytest.mark.parametrize("others", [0, 1, 2])
@pytest.mark.parametrize("skew", [0.0, 1e-3, -1e-3])
def test_a_small_row_beside_a_large_one_is_met_at_its_own_scale(others, skew):
    """|ell| |u| + |b| of the large row is a million times what the small one asks for."""
    ell = np.zeros((2 + others, 2 + others), np.float32)
    ell[0, :2] = [1.0, skew]
    ell[range(1, 2 + others), range(1, 2 + others)] = 1.0
    b = np.array([1e6, *[0.9] * (1 + others)], np.float32)
    u, feasible = solve_all(ell[None], b[None], np.float32)
    assert feasible[0]
    terms = ell[1:].astype(float) * u[0].astype(float)
    lack = terms.sum(-1) + b[1:]
    assert np.all(lack <= 1e-5 * (np.abs(terms).sum(-1) + b[1:]))
    assert np.linalg.norm(u[0]) <= 1e6 * (1 + 1e-5)


@pytest.mark.parametrize("inputs", [3, 4])
def test_small_rows_that_contradict_each_other_beside_a_large_one_are_infeasible(inputs):
    ell = np.zeros((1, 3, inputs), np.float32)
    ell[0, 0, 0], ell[0, 1, 1], ell[0, 2, 1] = 1.0, 1.0, -1.0
    for small, possible in ((0.9, False), (-0.9, True)):
        b = np.array([[1e6, 0.9, small]], np.float32)
        assert solve_all(ell, b, np.float32)[1][0] == possible


@pytest.mark.parametrize("rows", [1, 2, 3, 5])
@pytest.mark.parametrize("where", ["ell", "b"])
@pytest.mark.parametrize("what", [np.nan, np.inf, -np.inf])
def test_a_row_that_is_not_finite_is_infeasible_and_left_out(rows, where, what):
    rng = np.random.default_rng(rows)
    ell = np.abs(rng.normal(size=(rows, 3)))  # no two of them opposed
    b = np.abs(rng.normal(size=rows))
    without, fine = solve_all(ell[None, 1:], b[None, 1:], np.float32)
    assert fine[0]
    bad_ell, bad_b = ell.copy(), b.copy()
    if where == "ell":
        bad_ell[0, 1] = what
    else:
        bad_b[0] = what
    u, feasible = solve_all(bad_ell[None], bad_b[None], np.float32)
    assert feasible[0] == (where == "b" and what == -np.inf)  # which asks for nothing
    np.testing.assert_allclose(u, without, rtol=1e-5, atol=1e-5)
    boxed, feasible = solve_all(bad_ell[None], bad_b[None], np.float32, box=10.0)
    assert np.isfinite(boxed).all()
    assert feasible[0] == (where == "b" and what == -np.inf)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_an_input_too_large_for_its_numbers_is_infeasible_and_finite(rows):
    ell = np.zeros((rows, 3), np.float32)
    ell[range(rows), range(rows)] = 1e-20
    b = np.full(rows, 1e20, np.float32)
    u, feasible = solve_all(ell[None], b[None], np.float32)
    assert not feasible[0]
    assert np.isfinite(u).all()
    u, feasible = solve_all(
        1e40 * ell.astype(float)[None], 1e-40 * b.astype(float)[None], np.float32
    )
    assert feasible[0]  # too small, and so a little larger than need be
    assert np.all(u[0, :rows] < 0)


def test_nearly_opposed_rows_whose_planes_meet_beyond_all_numbers_are_infeasible():
    ell = np.array([[[1.0, 0.0], [-1.0, 1e-4]]], np.float32)
    u, feasible = solve_all(ell, np.full((1, 2), 1e36, np.float32), np.float32)
    assert not feasible[0]
    assert np.isfinite(u).all()


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("box", [1e-15, 0.3, 1e15])
@pytest.mark.parametrize(("rows", "inputs"), [(1, 1), (2, 2), (2, 3), (3, 6)])
def test_a_box_keeps_rows_met_at_every_scale(dtype, box, rows, inputs):
    """What is clipped to the box meets its rows, or says that it does not; a linear program agrees."""
    rng = np.random.default_rng(rows + inputs)
    ell = rng.normal(size=(100, rows, inputs)) * 10.0 ** rng.uniform(-5, 5, (100, rows, 1))
    reach = np.abs(ell).sum(-1) * box  # a row with a larger b can't be met
    b = reach * rng.uniform(-1.0, 1.1, reach.shape)
    ell, b = ell.astype(dtype), b.astype(dtype)
    u, feasible = solve_all(ell, b, dtype, box)
    assert 0 < feasible.mean() < 1
    assert np.all(np.abs(u) <= np.array(box, dtype))
    assert np.all(violation(ell, b, u)[feasible] <= FEW_EPS * np.finfo(dtype).eps)
    for k in range(len(ell)):
        size = np.abs(ell[k]).sum(-1, keepdims=True).astype(float)
        offset = b[k].astype(float) / size[:, 0] / box
        found = linprog(np.zeros(inputs), ell[k] / size, -offset, bounds=(-1, 1))
        assert feasible[k] == (found.status == 0)


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("spread", [1.0, 1e2, 1e4])
def test_a_metric_with_inputs_of_different_units_leaves_rows_met(rows, spread):
    rng = np.random.default_rng(rows)
    ell, b = rng.normal(size=(100, rows, 3)), rng.normal(size=(100, rows))
    unit = np.diag([1.0, spread**0.5, spread**-0.5])
    metric = unit @ (np.eye(3) + 0.3) @ unit
    run = jax.jit(jax.vmap(min_norm_input, in_axes=(0, 0, None)))
    u, feasible = run(*(jnp.asarray(each, jnp.float32) for each in (ell, b, metric)))
    ell, b = ell.astype(np.float32), b.astype(np.float32)
    found = violation(ell, b, np.asarray(u))[np.asarray(feasible)]
    assert np.all(found <= FEW_EPS * np.finfo(np.float32).eps)
    assert np.mean(feasible) > 0.95


@pytest.mark.parametrize("rows", [1, 2])
def test_gradients_are_those_of_finite_differences_at_every_scale(rows):
    rng = np.random.default_rng(3)
    ell, b = rng.normal(size=(rows, 3)), np.array([1.0, 0.8])[:rows]
    for scale in (1.0, 1e-15, 1e15):
        with jax.enable_x64(True):

            def effort(ell, b=b * scale):
                return jnp.sum(min_norm_input(ell, jnp.asarray(b)).u ** 2)

            slope = np.asarray(jax.grad(effort)(jnp.asarray(ell * scale)))
            step = 1e-6 * scale
            for index in np.ndindex(ell.shape):
                aside = np.zeros_like(ell)
                aside[index] = step
                change = effort(jnp.asarray(ell * scale + aside)) - effort(
                    jnp.asarray(ell * scale - aside)
                )
                assert slope[index] * scale == pytest.approx(
                    float(change) / 2e-6, rel=1e-4, abs=1e-6
                )


def test_metrics_that_are_fine():
    for metric in (
        None,
        np.eye(2),
        jnp.eye(3, dtype=jnp.float32),
        np.stack([np.eye(2), 2 * np.eye(2)]),
        np.diag([1e-20, 1e20]),  # inputs of different units
        np.array([[2.0, 1.0], [1.0 + 1e-7, 2.0]]),  # rounding
    ):
        check_metric(metric)
    jax.jit(lambda metric: check_metric(metric) or metric)(-jnp.eye(2))  # not known yet


@pytest.mark.parametrize(
    ("metric", "error", "message"),
    [
        ([[1.0]], TypeError, "`metric` must be an array"),
        (np.eye(2, dtype=int), TypeError, "`metric` must hold floating-point numbers; got int"),
        (np.ones(3), ValueError, r"`metric` must have shape \(inputs, inputs\).*got \(3,\)"),
        (np.ones((2, 3)), ValueError, r"`metric` must have shape .*got \(2, 3\)"),
        (np.array([[1.0, 2.0], [0.0, 1.0]]), ValueError, r"symmetric; got 2 at \(0, 1\) and 0 at"),
        (np.ones((2, 2)), ValueError, "positive definite; got a matrix whose least eigenvalue is"),
        (np.stack([np.eye(2), -np.eye(2)]), ValueError, "of agent 1 must be positive definite; got -1"),
        (np.full((2, 2), np.nan), ValueError, "`metric` must be finite"),
    ],
)  # fmt: skip
def test_metrics_that_are_refused(metric, error, message):
    with pytest.raises(error, match=message):
        check_metric(metric)


def test_a_metric_must_fit_the_inputs():
    check_metric(np.eye(3), 3)
    with pytest.raises(ValueError, match=r"`metric` must have shape \(3, 3\).*got \(2, 2\)"):
        check_metric(np.eye(2), 3)


def test_a_metric_is_looked_at_by_the_qp_too():
    with pytest.raises(ValueError, match="`metric` must be positive definite"):
        min_norm_input(jnp.ones((1, 2)), jnp.ones(1), -jnp.eye(2))


@pytest.mark.parametrize("limit", ["box", "norm"])
@pytest.mark.parametrize(
    ("value", "error"),
    [(0.0, ValueError), (-1.0, ValueError), (float("nan"), ValueError), ("1", TypeError)],
)
def test_limits_are_positive_numbers(limit, value, error):
    """Called without the type checker of the tests, which would be the first to complain."""
    limits = {"box": None, "norm": None} | {limit: value}
    with pytest.raises(error, match=rf"`{limit}` must be .*; got '?{value}"):
        getattr(check_limits, "__wrapped__", check_limits)(**limits)


WRONG = """
import jax.numpy as jnp
from deggflow.guidance import min_norm_input

one, rows = jnp.ones(1), jnp.ones((1, 2))
for arguments in (
    (jnp.ones(2), one), (rows, jnp.ones(2)), (rows, jnp.ones((1, 1))), (rows, one, jnp.eye(3)),
    (rows, one, jnp.eye(2)[None]), (jnp.ones((1, 2), int), one), ([[1.0, 2.0]], one), (rows, [1.0]),
):
    try:
        min_norm_input(*arguments)
    except (TypeError, ValueError) as error:
        print(type(error).__name__, error)
    else:
        print("nothing")
"""


def test_arguments_that_do_not_fit_are_named():
    """In a process of its own: here the type checker would be the first to complain."""
    run = subprocess.run([sys.executable, "-c", WRONG], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == [
        "ValueError `ell` must have shape (rows, inputs), one row per requirement; got (2,).",
        "ValueError `b` must have shape (1,), one number per row of `ell`; got (2,).",
        "ValueError `b` must have shape (1,), one number per row of `ell`; got (1, 1).",
        "ValueError `metric` must have shape (2, 2), or (agents, 2, 2) with one matrix per agent; got (3, 3).",
        "ValueError `metric` must be the one matrix of this agent, of shape (2, 2); got (1, 2, 2).",
        "TypeError `ell` must be an array of floating-point numbers, of shape (rows, inputs); got one of int32.",
        "TypeError `ell` must be an array of floating-point numbers, of shape (rows, inputs); got list.",
        "TypeError `b` must be an array of floating-point numbers, of shape (rows,); got list.",
    ]
