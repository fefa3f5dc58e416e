"""Drifts that evaluate the field less often than guidance: their order, their grid and their solution, by SciPy."""

import itertools
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow import (
    AfterPrediction,
    Extrapolated,
    ExtrapolatedEndpoint,
    Held,
    Midpoint,
    NoGuidance,
    generate,
    refined_grid,
)
from deggflow.drift import aligned, macro_grid
from deggflow.solver import EULER, HEUN, RK4

AGENTS = 3
MATRIX = jnp.array([[-1.0, 2.0], [-2.0, -0.5]])


def smooth(tau, z, condition):
    return jnp.tanh(z @ MATRIX.T) + jnp.sin(3 * tau)


def smooth_64(tau, z):
    """The same in NumPy, whose programs need not be compiled."""
    return np.tanh(z @ np.asarray(MATRIX, np.float64).T) + np.sin(3 * tau)


def solution(slope, begin, end, z, points=None, tolerance=1e-12):
    """Of dz/dtau = slope(tau, z), by SciPy: at the end, or at some points."""
    solved = scipy.integrate.solve_ivp(
        lambda tau, flat: slope(tau, flat.reshape(z.shape)).ravel(),
        (begin, end), z.ravel(), "DOP853", points, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    return solved.y.T.reshape(-1, *z.shape)


@cache
def smooth_problem():
    """A start, and where the smooth field carries it."""
    with jax.enable_x64(True):
        z0 = np.asarray(jax.random.normal(jax.random.key(0), (AGENTS, 2)))
    return z0, solution(smooth_64, 0.0, 1.0, z0)[-1]


def endpoint_3(evaluations, power):
    return ExtrapolatedEndpoint(evaluations, 3, power)


compiled_generate = eqx.filter_jit(generate)


def nominal_end(drift, z0, steps=150, solver=EULER):
    grid = refined_grid(steps)
    return np.asarray(
        compiled_generate(smooth, NoGuidance(), z0, None, grid=grid, drift=drift, solver=solver).z
    )


@pytest.mark.parametrize("power", [1.0, 1.5])
@pytest.mark.parametrize(
    ("make", "order"),
    [
        (Held, 1),
        (Midpoint, 2),
        (lambda evaluations, power: Extrapolated(evaluations, 2, power), 2),
        (lambda evaluations, power: Extrapolated(evaluations, 3, power), 3),
        (lambda evaluations, power: ExtrapolatedEndpoint(evaluations, 2, power), 2),
        (endpoint_3, 2),
        (lambda evaluations, power: AfterPrediction(Midpoint(evaluations, power)), 2),
    ],
    ids=[
        "held",
        "midpoint",
        "extrapolated-2",
        "extrapolated-3",
        "endpoint-2",
        "endpoint-3",
        "predicted",
    ],
)
def test_the_nominal_part_has_its_order(make, order, power):
    z0, exact = smooth_problem()
    with jax.enable_x64(True):
        errors = [
            np.abs(nominal_end(make(evaluations, power), z0) - exact).max()
            for evaluations in (32, 128)
        ]
    slope = np.log2(errors[0] / errors[1]) / 2
    assert slope > order - 0.25, errors
    # With equal steps the first ones, of lower order, still weigh little at these lengths.
    starts_lower = make is endpoint_3
    assert slope < order + (0.75 if starts_lower else 0.25), errors


def test_the_nominal_part_is_adams_and_bashforth_s_on_any_grid_and_scheme(key):
    """With steps that differ, by the weights that integrate the polynomial exactly."""
    start = np.asarray(jax.random.normal(key, (AGENTS, 2)), np.float64)
    tau, z, before = macro_grid(8), start, None
    with jax.enable_x64(True):
        for begin, end in itertools.pairwise(tau):
            h, f = end - begin, smooth_64(begin, z)
            if before is None:
                step = h * f
            else:
                step = h * (f + h / (2 * (begin - before[0])) * (f - before[1]))
            z, before = z + step, (begin, f)
        for steps, solver in ((8, EULER), (33, EULER), (150, EULER), (20, HEUN), (20, RK4)):
            ours = nominal_end(Extrapolated(8), jnp.asarray(start), steps, solver)
            np.testing.assert_allclose(ours, z, atol=1e-12)


@pytest.mark.parametrize("order", [2, 3])
def test_an_extrapolated_endpoint_is_reached_by_the_exact_solution(order):
    """dz/dtau = (x1(tau) - z) / (1 - tau) with the polynomial through the last endpoints, by SciPy."""
    z, _ = smooth_problem()
    with jax.enable_x64(True):
        ours = compiled_generate(
            smooth, NoGuidance(), z, None, grid=refined_grid(60), keep_path=True,
            drift=ExtrapolatedEndpoint(5, order, 1.5),
        )  # fmt: skip
    grid, tau, known = np.asarray(ours.trace.tau), macro_grid(5, 1.5), []
    for begin, end in itertools.pairwise(tau):
        known = [*known, (begin, z + (1 - begin) * smooth_64(begin, z))][-order:]
        powers = np.polyfit([t for t, _ in known], [x.ravel() for _, x in known], len(known) - 1)

        def slope(tau, z, powers=powers):
            endpoint = sum(each * tau**power for power, each in enumerate(powers[::-1]))
            return (endpoint.reshape(z.shape) - z) / (1 - tau)

        points = grid[(grid > begin) & (grid <= min(end, 1 - 1e-9))]
        path = solution(slope, begin, points[-1], z, points, 1e-11)
        np.testing.assert_allclose(
            ours.path[np.searchsorted(grid, points)], path, rtol=1e-8, atol=1e-8
        )
        z = path[-1]
    # The exact solution ends at the endpoint that is extrapolated to tau = 1.
    np.testing.assert_allclose(ours.z, powers.sum(axis=0).reshape(z.shape), atol=1e-8)


def test_a_field_that_always_predicts_one_endpoint_is_followed_exactly(key):
    target = jnp.array([[0.2, 0.0], [0.0, 0.3], [-0.3, 0.1]])

    def straight(tau, z, condition):
        return (target - z) / (1 - tau)

    z0 = jax.random.normal(key, (AGENTS, 2))
    for evaluations in (1, 4, 16):
        drift = ExtrapolatedEndpoint(evaluations)
        made = compiled_generate(straight, NoGuidance(), z0, None, drift=drift, keep_path=True)
        tau = np.asarray(made.trace.tau)[:, None, None]
        line = (1 - tau) * np.asarray(z0) + tau * np.asarray(target)
        np.testing.assert_allclose(made.path, line, atol=2e-6)


@settings(deadline=None, max_examples=60)
@given(
    points=st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=40),
    evaluations=st.integers(1, 40),
    power=st.floats(0.5, 3.0),
)
def test_the_grid_has_the_macro_grid_s_points(points, evaluations, power):
    """As many points as before, in order, those of the macro grid among them."""
    grid = np.concatenate([[0.0], np.cumsum(points) / np.sum(points)])
    grid[-1] = 1.0
    macro = macro_grid(evaluations, power)
    with jax.enable_x64(True):
        if evaluations > len(points):
            with pytest.raises(ValueError, match="`grid` must have at least as many steps"):
                aligned(jnp.asarray(grid), macro)
            return
        new, starts = jax.tree.map(np.asarray, aligned(jnp.asarray(grid), macro))
    assert new.shape == grid.shape
    assert (new[0], new[-1]) == (0, 1)
    assert np.all(np.diff(new) > 0)
    np.testing.assert_array_equal(new[starts], macro[:-1])
    others = np.setdiff1d(np.arange(len(new)), starts)
    np.testing.assert_array_equal(new[others], grid[others])


def test_fixed_steps_have_a_gradient():
    with jax.enable_x64(True):
        z0 = jnp.asarray(np.random.default_rng(1).normal(size=(AGENTS, 2)))

        @jax.jit
        def end(z0):
            out = generate(
                smooth, NoGuidance(), z0, None, drift=Extrapolated(6), guard=None,
                grid=refined_grid(12),
            )  # fmt: skip
            return jnp.sum(out.z**2)

        gradient, eps = np.asarray(jax.jit(jax.grad(end))(z0)), 1e-6
        ahead = jnp.zeros_like(z0).at[1, 0].set(eps)
        slope = (end(z0 + ahead) - end(z0 - ahead)) / (2 * eps)
    assert gradient[1, 0] == pytest.approx(float(slope), rel=1e-6)
