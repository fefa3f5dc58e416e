"""The bound by steps along random paths, in random fields, and for every drift of the library."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deggflow import (
    DecoupledGuidance,
    Extrapolated,
    Held,
    Midpoint,
    NoGuidance,
    PrivateRequirement,
    StepGuard,
    generate,
    refined_grid,
)
from deggflow.deviation import couple, drift_along, step_bound
from deggflow.drift import EveryStep, aligned

DRIFTS = (EveryStep(), Held(8), Midpoint(8), Extrapolated(8), Extrapolated(8, order=3))


def length(x):
    return np.sqrt(np.sum(np.asarray(x, np.float64) ** 2, axis=(-2, -1)))


@given(st.integers(0, 10**6), st.booleans())
def test_any_two_paths_are_within_the_bound(seed, uniform):
    """Whatever the paths and the drifts are: what the drifts do not explain counts as an input."""
    rng = np.random.default_rng(seed)
    grid = np.sort(np.append(rng.uniform(size=7), [0.0, 1.0]))
    nominal, guided = rng.normal(size=(2, 5, 9, 2, 3))
    difference = 4 * rng.normal(size=(5, 8, 2, 3))
    together = rng.uniform(size=(5, 9)) < 0.3
    guided[together] = nominal[together]
    bound = step_bound(grid, nominal, guided, difference, uniform=uniform)
    assert np.all(length(guided[:, -1] - nominal[:, -1]) <= bound * (1 + 1e-12) + 1e-12)


@given(st.integers(0, 10**6))
def test_one_push_gives_the_exact_distance(seed):
    """A linear field stretches what one push leaves: no direction is lost."""
    rng = np.random.default_rng(seed)
    matrix, grid = 3 * rng.normal(size=(6, 6)), np.linspace(0, 1, 21)
    y = rng.normal(size=(1, 6))
    paths, push = [y, y], rng.normal(size=(1, 6))
    walked = [[y], [y]]
    for k in range(20):
        paths = [x + 0.05 * (x @ matrix.T) for x in paths]
        paths[1] = paths[1] + (push if k == 3 else 0.0)
        for each, x in zip(walked, paths, strict=True):
            each.append(x)
    nominal, guided = (np.stack(each, axis=1).reshape(1, 21, 2, 3) for each in walked)
    gap = (guided - nominal).reshape(1, 21, 6)[:, :-1]
    bound = step_bound(grid, nominal, guided, (gap @ matrix.T).reshape(1, 20, 2, 3))
    assert bound == pytest.approx(length(guided[:, -1] - nominal[:, -1]), rel=1e-6)


def swirl(tau, z, condition):
    turned = jnp.stack([-z[:, 1], z[:, 0]], axis=-1)
    return 3 * jnp.tanh(turned + tau) - z * jnp.sum(z**2)


def apart(z, condition):
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(len(z))[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


GUIDANCE = DecoupledGuidance((PrivateRequirement(apart, buffer=0.05, name="apart"),))


@pytest.mark.parametrize("drift", DRIFTS, ids=str)
def test_the_drift_along_a_nominal_path_is_the_one_that_made_it(drift, key):
    z0, grid = 0.5 * jax.random.normal(key, (3, 2)), refined_grid(24)
    made = generate(
        swirl, NoGuidance(), z0, None, grid=grid, drift=drift, guard=None, keep_path=True
    )
    moved, _ = aligned(grid, drift.macro_grid())
    step = np.diff(moved)[:, None, None]
    for given_grid in (grid, moved):
        found = drift_along(swirl, drift, given_grid, made.path, None)
        np.testing.assert_allclose(step * found, np.diff(made.path, axis=0), atol=2e-6)


@pytest.mark.parametrize("guard", [None, StepGuard()], ids=["fixed", "guarded"])
@pytest.mark.parametrize("drift", DRIFTS[::2], ids=str)
def test_guided_samples_are_within_the_bound(drift, guard, key):
    z0 = 0.5 * jax.random.normal(key, (6, 3, 2))
    coupled = couple(swirl, GUIDANCE, z0, None, grid=refined_grid(24), drift=drift, guard=guard)
    along = [
        jax.vmap(lambda path: drift_along(swirl, drift, coupled.tau, path, None))(paths)
        for paths in (coupled.nominal, coupled.guided)
    ]
    given_paths = (np.asarray(each, np.float64) for each in coupled[:3])
    arguments = (*given_paths, np.asarray(along[1] - along[0], np.float64))
    bound, uniform = (step_bound(*arguments, uniform=each) for each in (False, True))
    gap = length(coupled.guided[:, -1] - coupled.nominal[:, -1])
    assert np.all(gap <= bound * (1 + 1e-12))
    assert np.all(bound <= uniform * (1 + 1e-12))
    assert np.mean(bound) < 5 * np.mean(gap)
    if guard is None:  # the rest of every step is its input, up to rounding
        sizes = np.diff(coupled.tau)
        carried = arguments[2] - arguments[1]
        rest = np.diff(carried, axis=1) - sizes[:, None, None] * arguments[3]
        np.testing.assert_allclose(
            length(rest), sizes * np.asarray(coupled.correction)[:, :-1], atol=2e-6
        )
