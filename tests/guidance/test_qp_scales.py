"""The local QP at every scale of its rows and of its input, against exact arithmetic and linear programs."""

from fractions import Fraction
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from deggflow.guidance import min_norm_input

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
