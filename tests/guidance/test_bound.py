"""Bounds of shared requirements: eqn:SE_beta_start, their ends, and that they are C^1."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.guidance import AbstractBound, TighteningBound

values = st.floats(-50, 50)


def cosine(tau):
    """A profile of one's own."""
    return (1 + jnp.cos(jnp.pi * tau)) / 2


def far(condition):
    """What it comes to at tau = 1 depends on z(0), and does not matter here."""
    return jnp.inf


class Exponential(AbstractBound):
    """A bound of one's own: decays from q(z(0)) + 0.05 at the rate of the condition."""

    end: Callable = far

    def init(self, value, condition):
        return value + 0.05, condition

    def __call__(self, state, tau):
        start, rate = state
        return start * jnp.exp(-rate * tau)


def given_end(condition):
    return condition


BOUNDS = {
    "paper's": TighteningBound(end=given_end),
    "paper's for the task factor": TighteningBound(end=given_end, least=0.02),
    "without slack": TighteningBound(end=given_end, slack=0.0),
    "own profile": TighteningBound(end=given_end, profile=cosine),
    "own bound": Exponential(),
}


@partial(jax.jit, static_argnums=0)
def _sampled(bound, value, condition, tau):
    state = bound.init(value, condition)
    return jax.vmap(lambda t: bound(state, t))(tau)


def sampled(bound, value, condition, points=401):
    """beta on an even grid of tau, in float64."""
    tau = np.linspace(0.0, 1.0, points)
    with jax.enable_x64(True):
        return tau, np.asarray(_sampled(bound, jnp.asarray(value), jnp.asarray(condition), tau))


@pytest.mark.parametrize("name", BOUNDS)
@settings(max_examples=25, deadline=None)
@given(value=values, end=values)
def test_starts_at_or_above_the_factor(name, value, end):
    """eqn:SE_beta_start, for rising and falling bounds, up to rounding."""
    _, beta = sampled(BOUNDS[name], value, end, 2)
    assert beta[0] >= value - 1e-15 * (1 + abs(value) + abs(end))


@pytest.mark.parametrize("name", [name for name in BOUNDS if name != "own bound"])
@settings(max_examples=25, deadline=None)
@given(value=values, end=values)
def test_ends_where_the_condition_says(name, value, end):
    _, beta = sampled(BOUNDS[name], value, end, 2)
    assert beta[-1] == pytest.approx(end, abs=1e-12)


def test_the_end_is_zero_unless_said_otherwise():
    """A plain hard requirement: q(1) <= 0."""
    _, beta = sampled(TighteningBound(), 3.0, 0.0)
    assert beta[-1] == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(value=values, end=values)
def test_papers_start_values(value, end):
    """beta_task,start = max(q + 0.02, end + 0.02); beta_safe,start = q + 0.02 (paper, App. on Task 1)."""
    _, task = sampled(BOUNDS["paper's for the task factor"], value, end, 2)
    _, safe = sampled(BOUNDS["paper's"], value, end, 2)
    assert task[0] == pytest.approx(max(value + 0.02, end + 0.02), abs=1e-9)
    assert safe[0] == pytest.approx(value + 0.02, abs=1e-9)


def test_papers_profile():
    """1 - 6 tau^5 + 15 tau^4 - 10 tau^3."""
    tau, profile = sampled(TighteningBound(slack=0.0), 1.0, 0.0)
    np.testing.assert_allclose(profile, 1 - 6 * tau**5 + 15 * tau**4 - 10 * tau**3, atol=1e-12)


@pytest.mark.parametrize(("value", "end"), [(4.0, -1.0), (-4.0, 1.0), (0.0, 0.0)])
def test_quintic_bounds_are_monotone(value, end):
    """Between their ends, never beyond."""
    _, beta = sampled(BOUNDS["paper's"], value, end)
    direction = np.sign(end - beta[0])
    assert np.all(np.diff(beta) * direction >= -1e-14)
    assert beta.min() >= min(beta[0], end) - 1e-12
    assert beta.max() <= max(beta[0], end) + 1e-12


def test_with_least_a_bound_only_falls():
    """Where q(z(0)) is far below the end value already, the bound starts above its end all the same."""
    _, beta = sampled(TighteningBound(end=given_end, least=0.3), -5.0, 1.0)
    assert beta[0] == pytest.approx(1.3)
    assert np.all(np.diff(beta) <= 1e-14)


@pytest.mark.parametrize("name", BOUNDS)
def test_continuously_differentiable(name):
    """The derivative that the rows use is that of finite differences, and has no jumps."""
    bound = BOUNDS[name]
    tau, beta = sampled(bound, 2.0, -1.0, 2001)

    def slopes(value, condition, tau):
        state = bound.init(value, condition)
        return jax.vmap(jax.grad(lambda t: bound(state, t)))(tau)

    with jax.enable_x64(True):
        slope = np.asarray(jax.jit(slopes)(jnp.asarray(2.0), jnp.asarray(-1.0), jnp.asarray(tau)))
    np.testing.assert_allclose(
        slope[1:-1], (beta[2:] - beta[:-2]) / (tau[2:] - tau[:-2]), atol=1e-4
    )
    assert np.abs(np.diff(slope)).max() <= 0.02


def test_the_papers_bound_is_flat_at_both_ends():
    """First and second differences vanish there: nothing is asked for abruptly."""
    tau, beta = sampled(TighteningBound(), 1.0, 0.0, 1001)
    slope = np.diff(beta) / np.diff(tau)
    assert np.abs(slope[[0, -1]]).max() < 1e-4
    assert np.abs(np.diff(slope)[[0, -1]] / np.diff(tau)[0]).max() < 0.2


@pytest.mark.parametrize("slack", [-0.01, float("nan")])
def test_a_bound_below_the_factor_is_refused(slack):
    with pytest.raises(ValueError, match=f"`slack` must not be negative.* got {slack}"):
        TighteningBound(slack=slack)
