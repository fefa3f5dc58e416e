"""phi_delta, effective directions and weights: what the proof of prop:c2_feasibility uses, and the proposition."""

from fractions import Fraction
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from deggflow.guidance import (
    DecoupledGuidance,
    Fixed,
    Local,
    Own,
    Pooled,
    min_norm_input,
)
from deggflow.guidance.directions import effective_directions, phi

AGENTS, DIM, DELTA = 4, 3, 0.02
PARALLEL = 1e-10  # squared sine below which opposed rows are left out: rounding decides there
numbers = st.floats(-8, 8, width=32).map(lambda x: 0.0 if abs(x) < 1e-3 else x)
rows = arrays(np.float64, (2, AGENTS, DIM), elements=numbers)
incidences = arrays(np.bool_, (2, AGENTS)).filter(lambda who: bool(who.any(axis=1).all()))


def double(function, *arguments):
    """A compiled function in float64, numpy in and out."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, function(*(jnp.asarray(a) for a in arguments)))


phi_of = jax.jit(phi, static_argnums=1)
directions_of = jax.jit(effective_directions)
solve = jax.jit(jax.vmap(min_norm_input, in_axes=1))


def papers_phi(eta, delta):
    """Proof of prop:c2_feasibility, case by case."""
    if eta <= -delta:
        return eta
    if eta >= delta:
        return 0.0
    return delta * (eta / delta - 1) ** 3 * (eta / delta + 3) / 16


@pytest.mark.parametrize("delta", [0.02, 0.3, 0.9])
def test_phi_is_the_papers_and_at_most_min_of_eta_and_zero(delta):
    eta = np.concatenate([np.linspace(-1, 1, 2001), np.linspace(-2 * delta, 2 * delta, 2001)])
    eta = np.clip(eta, -1, 1)
    value = double(lambda e: phi_of(e, delta), eta)
    np.testing.assert_allclose(value, [papers_phi(e, delta) for e in eta], atol=1e-12)
    assert np.all(value <= np.minimum(eta, 0.0) + 1e-15)
    assert np.all((value >= -1.0) & (value <= 0.0))


@pytest.mark.parametrize("delta", [0.02, 0.3])
@pytest.mark.parametrize("end", [-1, 1])
def test_phi_is_twice_continuously_differentiable(delta, end):
    """Value, slope and curvature from the left are those from the right at -delta and at delta.

    One-sided differences of second order, in units of delta; their errors vanish with the step.
    """

    def one_sided(h):
        points = end * delta + h * delta * np.arange(4)
        f0, f1, f2, f3 = double(lambda e: phi_of(e, delta), points)
        slope = (-3 * f0 + 4 * f1 - f2) / (2 * h)
        return np.array([f0, slope, (2 * f0 - 5 * f1 + 4 * f2 - f3) / h**2]) / delta

    step = 1e-3
    np.testing.assert_allclose(one_sided(step), one_sided(-step), atol=1e-2 * np.sqrt(step))


def inner(a, b):
    return np.einsum("nd,nd->n", a, b)


@settings(max_examples=100, deadline=None)
@given(rows)
def test_effective_directions_never_work_against_a_row(ell):
    """l2.d1 >= 0, l1.d2 >= 0; l1.d1 > 0 and l2.d2 > 0 unless d vanishes (proof of prop:c2_feasibility)."""
    d = double(directions_of, ell)
    size = np.linalg.norm(ell, axis=-1)
    product = size[0] * size[1]
    assert np.all(inner(ell[1], d[0]) >= -1e-12 * product)
    assert np.all(inner(ell[0], d[1]) >= -1e-12 * product)
    for a in range(2):
        helps = inner(ell[a], d[a])
        assert np.all(helps >= -1e-12 * size[a] ** 2)
        there = np.linalg.norm(d[a], axis=-1) > 1e-6 * size[a]
        assert np.all(helps[there & (size[a] > 0)] > 0)


@settings(max_examples=100, deadline=None)
@given(rows)
def test_effective_directions_are_the_papers(ell):
    """d1 = l1 - |l1| phi(eta) hat l2, and the same the other way round, agent by agent."""
    d = double(directions_of, ell)
    for i in range(AGENTS):
        one, two = ell[:, i]
        size = np.linalg.norm(one), np.linalg.norm(two)
        if size[0] == 0 or size[1] == 0:  # at most one live row: d = l
            expected = [one, two]
        else:
            against = papers_phi(np.clip(one @ two / size[0] / size[1], -1, 1), DELTA)
            expected = [
                one - size[0] * against * two / size[1],
                two - size[1] * against * one / size[0],
            ]
        np.testing.assert_allclose(d[:, i], expected, atol=1e-10)


def test_a_factor_an_agent_cannot_change_leaves_the_other_as_it_is():
    ell = np.array([[[3.0, -4.0]], [[0.0, 0.0]]])
    for order in (ell, ell[::-1]):
        np.testing.assert_array_equal(double(directions_of, order), order)


def test_one_factor_alone_has_its_row_as_direction():
    ell = np.random.default_rng(0).normal(size=(1, AGENTS, DIM))
    np.testing.assert_array_equal(double(directions_of, ell), ell)


def test_opposed_rows_leave_nothing():
    ell = np.array([[[1.0, 2.0]], [[-2.0, -4.0]]])
    np.testing.assert_allclose(double(directions_of, ell), 0.0, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(arrays(np.float64, (3, AGENTS, DIM), elements=numbers))
def test_directions_of_three_factors_are_projections(ell):
    """The point nearest to l that no other row of the agent points away from, by nonnegative least squares."""
    d = double(directions_of, ell)
    for i, a in np.ndindex(AGENTS, 3):
        others = np.delete(ell[:, i], a, axis=0)
        size = np.linalg.norm(ell[a, i])
        rest = scipy.optimize.nnls(others.T, -ell[a, i])[1]  # |l + sum of nonnegative multiples|
        assert np.all(others @ d[a, i] >= -1e-7 * (1 + size * np.linalg.norm(others, axis=-1)))
        assert np.linalg.norm(d[a, i]) == pytest.approx(rest, abs=1e-6 * (1 + size))
        assert ell[a, i] @ d[a, i] == pytest.approx(rest**2, abs=1e-6 * (1 + size) ** 2)


@pytest.mark.parametrize("delta", [0.0, 1.0, -0.1, float("nan")])
def test_delta_outside_the_open_unit_interval_is_refused(delta):
    with pytest.raises(ValueError, match=r"`delta` must be in \(0, 1\)"):
        DecoupledGuidance((), delta=delta)


class Shares(NamedTuple):
    """Weights, and the effective directions they are made of."""

    weight: np.ndarray
    direction: np.ndarray


def shares(allocations):
    """Weights from the rows, as the guidance makes them: how each factor's agents divide a demand of one."""

    def weights(ell, who):
        direction = effective_directions(ell)
        square = jnp.sum(direction**2, axis=-1)
        weight = [
            allocation(
                who[a] / jnp.sum(who[a]), square[a], lambda a=a: who[a][:, None] & who[a][None]
            )
            for a, allocation in enumerate(allocations())
        ]
        return Shares(jnp.stack(weight), direction)

    return jax.jit(weights)


FIXED = np.array([[0.5, 1.0, 2.0, 0.0], [3.0, 0.0, 0.25, 1.0]], np.float32)
ALLOCATIONS = {
    "pooled": shares(lambda: [Pooled()] * 2),
    "local": shares(lambda: [Local()] * 2),
    "own": shares(lambda: [Own()] * 2),
    "fixed": shares(lambda: [Fixed(jnp.asarray(weight)) for weight in FIXED]),
}
pooled = ALLOCATIONS["pooled"]


@pytest.mark.parametrize("name", ALLOCATIONS)
@settings(max_examples=40, deadline=None)
@given(ell=rows, who=incidences)
def test_weights_are_nonnegative_add_up_to_one_and_stay_with_the_factors_agents(name, ell, who):
    """All that the finite-horizon theorem asks of them."""
    weight = double(ALLOCATIONS[name], np.where(who[..., None], ell, 0.0), who).weight
    assert np.all(weight >= 0)
    assert np.all(weight[~who] == 0)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(ell=rows)
def test_pooled_weights_are_in_proportion_to_the_square_of_the_direction(ell):
    """eqn:C2_weights: w_i |d_j|^2 = w_j |d_i|^2."""
    found = double(pooled, ell, np.ones((2, AGENTS), bool))
    square = np.sum(found.direction**2, axis=-1)
    for w, s in zip(found.weight, square, strict=True):
        if s.sum() > 0:
            np.testing.assert_allclose(np.outer(w, s), np.outer(s, w), atol=1e-9 * s.max())


@settings(max_examples=100, deadline=None)
@given(
    ell=rows,
    who=incidences,
    owed=arrays(np.float64, 2, elements=st.floats(-20, 20, width=32)),
    push=arrays(np.float64, (2, AGENTS), elements=st.floats(-5, 5, width=32)),
)
def test_pooled_shares_leave_every_agent_an_input(ell, who, owed, push):
    """prop:c2_feasibility: where its conditions hold, no agent's QP is infeasible.

    b_{a,i} = push_{a,i} + w_{a,i} owed_a, where push stands for grad q . f.
    """
    ell = np.where(who[..., None], ell, 0.0)
    share = double(pooled, ell, who)
    # An agent that has no gradient is not pushed either.
    b = np.where(np.any(ell != 0, axis=-1), push, 0.0) + share.weight * owed[:, None]
    d, size = share.direction, np.linalg.norm(ell, axis=-1)
    assume(np.all(np.sum(d**2, axis=(1, 2)) > 0))
    product = np.where(size[0] * size[1] > 0, size[0] * size[1], 1.0)
    sine2 = 1 - (inner(ell[0], ell[1]) / product) ** 2
    opposed = (inner(ell[0], ell[1]) < 0) & (sine2 <= PARALLEL)
    assume(not opposed.any())
    assume(np.all((b <= 0) | (np.linalg.norm(d, axis=-1) > 0)))
    u, feasible = double(solve, ell, b)
    assert feasible.all()
    slack = np.einsum("aid,id->ai", ell, u) + b
    assert np.all(slack <= 1e-7 * (1 + np.abs(b) + size * np.linalg.norm(u, axis=-1)[None]))
    # The proof's input meets the rows; the QP's is no larger.
    step = np.zeros_like(b)
    act = b > 0
    step[act] = b[act] / np.einsum("aid,aid->ai", ell, d)[act]
    proof = -np.einsum("ai,aid->id", step, d)
    slack = np.einsum("aid,id->ai", ell, proof) + b
    assert np.all(slack <= 1e-7 * (1 + np.abs(b) + size * np.linalg.norm(proof, axis=-1)[None]))
    longer = np.linalg.norm(u, axis=-1) - np.linalg.norm(proof, axis=-1)
    assert np.all(longer <= 1e-6 * (1 + np.linalg.norm(proof, axis=-1)))


# Opposed rows at the end of precision: whoever is said to have an effective direction has an input.


def nearly_opposed(rng, rows, inputs, dtype, count=1500):
    """Rows of all scales, most of them opposed or parallel to an earlier one within 1e-8 to 1e-1 rad, some exactly."""
    unit = rng.normal(size=(count, rows, inputs))
    for r in range(1, rows):
        base = unit[np.arange(count), rng.integers(0, r, count)]
        base /= np.linalg.norm(base, axis=-1, keepdims=True)
        aside = rng.normal(size=base.shape)
        aside -= np.sum(aside * base, axis=-1, keepdims=True) * base
        aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
        finest = -8 if dtype == np.float32 else -16
        angle = 10.0 ** rng.uniform(finest, -1, (count, 1)) * (rng.random((count, 1)) > 0.1)
        sign = np.where(rng.random((count, 1)) < 0.8, -1, 1)
        near = sign * (np.cos(angle) * base + np.sin(angle) * aside)
        unit[:, r] = np.where(rng.random((count, 1)) < 0.7, near, unit[:, r])
    ell = unit * 10.0 ** rng.uniform(-17, 17, (count, rows, 1))
    b = rng.normal(size=(count, rows)) * np.linalg.norm(ell, axis=-1)
    b *= 10.0 ** rng.uniform(-2, 2, b.shape)
    return ell.astype(dtype), b.astype(dtype)


def directions_and_inputs(ell, b, dtype):
    with jax.enable_x64(dtype == np.float64):
        d = directions_of(jnp.asarray(ell.swapaxes(0, 1)))
        found = solve(jnp.asarray(ell.swapaxes(0, 1)), jnp.asarray(b.T))
    return np.asarray(d).swapaxes(0, 1), np.asarray(found.u), np.asarray(found.feasible)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("rows", "inputs"), [(2, 2), (2, 3), (2, 24), (3, 3), (4, 3), (3, 5)])
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_who_has_an_effective_direction_wherever_it_must_act_has_an_input(
    dtype, rows, inputs, seed
):
    """prop:c2_feasibility for opposed rows of every scale, without a tolerance for the rows that oppose each other."""
    ell, b = nearly_opposed(np.random.default_rng(seed), rows, inputs, dtype)
    d, u, feasible = directions_and_inputs(ell, b, dtype)
    assert np.isfinite(d).all()
    assert np.isfinite(u).all()
    able = ((b <= 0) | (d != 0).any(axis=-1)).all(axis=-1)
    assert able.mean() > 0.2
    assert feasible[able].all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_rows_that_contradict_each_other_have_no_direction_and_no_input(dtype, seed):
    """ell_2 = -c ell_1 in exact arithmetic, with b_1 and b_2 / c apart by more than rounding."""
    rng = np.random.default_rng(seed)
    whole = rng.integers(-9, 10, (300, 3)).astype(float)
    whole[:, 0] += 100 * (whole == 0).all(axis=-1)
    c = rng.integers(1, 1000, (300, 1)) * 2.0 ** rng.integers(-40, 40, (300, 1))
    unit = 2.0 ** rng.integers(-40, 40, (300, 1))
    ell = (np.stack([whole, -c * whole], axis=1) * unit[..., None]).astype(dtype)
    b = rng.normal(size=(300, 2)).astype(dtype)
    b[:, 1] *= c[:, 0].astype(dtype)
    d, _, feasible = directions_and_inputs(ell, b, dtype)
    assert np.all(d == 0)
    for k in range(300):
        first, second = Fraction(float(b[k, 0])), Fraction(float(b[k, 1])) / Fraction(c[k, 0])
        gap = (first + second) / (abs(first) + abs(second))
        if abs(gap) > 20 * np.finfo(dtype).eps:
            assert feasible[k] == (gap <= 0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("rows", [2, 3])
@pytest.mark.parametrize("scale", [1e-20, 1e-12, 1e12, 1e20])
def test_directions_scale_with_their_own_row_alone(dtype, rows, scale):
    rng = np.random.default_rng(rows)
    ell = rng.normal(size=(rows, AGENTS, DIM)).astype(dtype)
    with jax.enable_x64(dtype == np.float64):
        plain = np.asarray(directions_of(jnp.asarray(ell)))
        ell[0] *= dtype(scale)
        scaled = np.asarray(directions_of(jnp.asarray(ell)))
    assert np.all(np.any(plain != 0, axis=-1))
    np.testing.assert_allclose(scaled[0] / dtype(scale), plain[0], atol=20 * np.finfo(dtype).eps)
    np.testing.assert_allclose(scaled[1:], plain[1:], atol=20 * np.finfo(dtype).eps)


@pytest.mark.parametrize("rows", [2, 3])
@pytest.mark.parametrize("what", [np.nan, np.inf])
def test_a_row_that_is_not_finite_has_no_direction_and_leaves_the_others_theirs(rows, what):
    ell = np.random.default_rng(0).normal(size=(rows, AGENTS, DIM))
    ell[0, 1, 2] = what
    d = double(directions_of, ell)
    ell[0, 1] = 0.0
    np.testing.assert_array_equal(d, double(directions_of, ell))
    assert np.all(d[0, 1] == 0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("factor", "there"), [(0.5, False), (2.0, True)])
def test_directions_of_two_rows_end_at_the_resolution(dtype, factor, there):
    angle = factor * 50 * np.finfo(dtype).eps
    ell = np.array([[[1.0, 0.0]], [[-1.0, angle]]], dtype)
    with jax.enable_x64(dtype == np.float64):
        d = np.asarray(directions_of(jnp.asarray(ell)))
    assert np.all(np.any(d != 0, axis=-1) == there)
    if there:
        np.testing.assert_allclose(np.linalg.norm(d, axis=-1), angle, rtol=1e-2)
