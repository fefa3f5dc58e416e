"""Statements of docs/theory.md that no other file follows: kinks, the floored gain, three rows, and the blend.

Trajectories, decays and projections are written out here in NumPy and SciPy.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, nnls

from deggflow.guidance.directions import effective_directions, phi
from deggflow.guidance.private import MIN_REMAINING

RHO, KAPPA, BUFFER = 0.75, 1.15, 0.02
FLOOR = BUFFER**2 / 2


def omega(tau):
    return 0.1 + 1.8 * tau


def remaining(tau):
    """R(tau) = int_tau^1 omega."""
    return (1 - tau) * (1 + 0.9 * tau)


# A violation with a kink: one agent z = (x, y), margin -x - |y|, a drift of 2 along x.

DRIFT, START = 2.0, (0.1, 0.05)


def violation(x, y, width):
    """max(buffer + x + |y|, 0)^2 / 2 and its gradient, |y| replaced by sqrt(y^2 + width^2)."""
    size = np.hypot(y, width)
    slope = y / size if size > 0 else 0.0
    deep = max(BUFFER + x + size, 0.0)
    return deep**2 / 2, np.array([deep, deep * slope])


def required(tau, value, start, reanchored):
    """C omega V^rho, with c from V(0) as in the paper or taken afresh."""
    if reanchored:
        return KAPPA / (1 - RHO) * omega(tau) / max(remaining(tau), MIN_REMAINING) * value
    return KAPPA / (1 - RHO) * start ** (1 - RHO) * omega(tau) * value**RHO


def bound(tau, start, reanchored):
    left = remaining(tau)
    if reanchored:
        return start * left ** (KAPPA / (1 - RHO))
    return start * max(1 - KAPPA * (1 - left), 0.0) ** (1 / (1 - RHO))


def along_rows(steps, width, reanchored):
    """V at every step, and the most that it is above its bound; the input is the shortest that meets the row."""
    x, y = START
    start, _ = violation(x, y, width)
    values, excess = [], -np.inf
    for tau in np.arange(steps) / steps:
        value, gradient = violation(x, y, width)
        values.append(value)
        excess = max(excess, value - bound(tau, start, reanchored))
        velocity = np.array([DRIFT, 0.0])
        b, square = (
            gradient @ velocity + required(tau, value, start, reanchored),
            gradient @ gradient,
        )
        if b > 0:
            assert square > 0  # the row can be met everywhere
            velocity -= b * gradient / square
        x, y = np.array([x, y]) + velocity / steps
    values.append(violation(x, y, width)[0])
    return np.array(values), max(excess, values[-1])


def sliding(reanchored):
    """V(1) and the greatest V of Filippov's solution along y = 0, from where the kink is reached.

    The two sides' velocities have opposite entries across the kink. Along it both have
    dx/dtau = (DRIFT - required / deep) / 2 with deep = buffer + x.
    """
    start, _ = violation(*START, 0.0)

    def velocity(tau, state):
        value, gradient = violation(state[0], max(state[1], 0.0), 0.0)
        b = gradient[0] * DRIFT + required(tau, value, start, reanchored)
        aside = b / (2 * gradient[0])  # both entries of the gradient are as deep
        return [DRIFT - aside, -aside if state[1] > 0 else 0.0]

    def touches(tau, state):
        return state[1]

    touches.terminal = True
    exact = {"rtol": 1e-10, "atol": 1e-12}
    there = solve_ivp(velocity, (0, 1), START, events=touches, **exact)
    after = solve_ivp(velocity, (there.t[-1], 1), [there.y[0, -1], 0.0], dense_output=True, **exact)
    path = [violation(x, 0.0, 0.0)[0] for x in after.sol(np.linspace(there.t[-1], 1, 2001))[0]]
    return path[-1], max(path)


@pytest.mark.parametrize("steps", [1_000, 10_000])
def test_v_rises_along_a_kink_although_every_row_is_met(steps):
    """thm:private_finite_time without C^1: V grows to twenty times V(0), whatever the step."""
    values, excess = along_rows(steps, 0.0, reanchored=False)
    end, _ = sliding(reanchored=False)
    assert values[0] == pytest.approx(0.01445)
    assert end == pytest.approx(0.2856, abs=1e-4)
    assert values[-1] == pytest.approx(end, abs=1.5 / steps)
    assert excess == pytest.approx(end, abs=1.5 / steps)  # the theorem promises V(1) = 0


def test_a_smoothing_narrower_than_a_step_moves_is_a_kink():
    """The width 1e-6 of the paper's task factor."""
    for steps in (1_000, 10_000):
        kink, smooth = (along_rows(steps, width, reanchored=False)[0][-1] for width in (0.0, 1e-6))
        assert smooth == pytest.approx(kink, abs=1.5 / steps)


@pytest.mark.parametrize("steps", [1_000, 10_000])
def test_a_gain_taken_afresh_leaves_its_bound_along_a_kink_too(steps):
    """V rises to eight times V(0); what grows without end is the gain, and it leads V back."""
    values, excess = along_rows(steps, 0.0, reanchored=True)
    _, most = sliding(reanchored=True)
    assert most == pytest.approx(0.1185, abs=1e-4)
    assert max(values) == pytest.approx(most, abs=1.0 / steps)
    assert excess > 8 * values[0]
    assert values[-1] < FLOOR


@pytest.mark.parametrize("reanchored", [False, True])
@pytest.mark.parametrize("width", [0.02, 0.05])
def test_a_smoothed_kink_keeps_v_below_its_bound(width, reanchored):
    """What is left above the bound falls with the step, as for any C^1 violation."""
    coarse, fine = (along_rows(steps, width, reanchored)[1] for steps in (1_000, 10_000))
    assert coarse == pytest.approx(6e-5, abs=2e-5)
    assert fine < 0.15 * coarse


# The gain with R floored where c divides by it.


def exponent(rho, kappa):
    return kappa / (1 - rho)


def decayed(start, rho, kappa, since=0.0, to=1.0):
    """V(to) of dV_j/dtau = -c omega V_j^rho, c = kappa V^(1 - rho) / ((1 - rho) max(R, floor)), owner by owner."""

    def rate(tau, parts):
        parts = np.maximum(parts, 0.0)
        gain = kappa * parts.sum() ** (1 - rho) / ((1 - rho) * max(remaining(tau), MIN_REMAINING))
        return -gain * omega(tau) * parts**rho

    floored = brentq(lambda tau: remaining(tau) - MIN_REMAINING, 0, 1, xtol=1e-15)
    parts = np.atleast_1d(start)
    for first, last in ((since, min(floored, to)), (max(floored, since), to)):
        if first < last:
            solved = solve_ivp(rate, (first, last), parts, "DOP853", rtol=1e-10, atol=1e-60)
            assert solved.success
            parts = solved.y[:, -1]
    return max(parts.sum(), 0.0)


RATES = [(rho, kappa) for rho in (0.05, 0.25, 0.5, 0.75, 0.9) for kappa in (1.0, 1.15, 2.0)]


@pytest.mark.parametrize(("rho", "kappa"), RATES)
def test_flooring_leaves_what_the_bound_says(rho, kappa):
    """V(1) <= V(s) (r / (e R(s)))^(kappa / (1 - rho)), with equality for one owner and rows met exactly."""
    power = exponent(rho, kappa)
    for since, start in ((0.0, 0.1), (0.0, 10.0), (0.6, 0.1)):
        left = start * (MIN_REMAINING / (np.e * remaining(since))) ** power
        assert decayed(start, rho, kappa, since) == pytest.approx(left, rel=1e-6)
    # From within the floored part: V(s) exp(-kappa / (1 - rho) R(s) / r).
    since = 0.997
    assert remaining(since) < MIN_REMAINING
    left = 0.1 * np.exp(-power * remaining(since) / MIN_REMAINING)
    assert decayed(0.1, rho, kappa, since) == pytest.approx(left, rel=1e-6)


@pytest.mark.parametrize(("rho", "kappa"), [(0.05, 1.0), (0.25, 1.15), (0.5, 2.0)])
def test_several_owners_leave_less(rho, kappa):
    """Three alike: sum_j V_j^rho = 3^(1 - rho) V^rho, and the exponent is as many times as large."""
    power, found = exponent(rho, kappa) * 3 ** (1 - rho), decayed(np.full(3, 0.2), rho, kappa)
    assert found == pytest.approx(0.6 * (MIN_REMAINING / np.e) ** power, rel=1e-6)
    assert found < decayed(0.6, rho, kappa)


@pytest.mark.parametrize(("rho", "kappa"), RATES)
def test_which_v_at_the_start_ends_below_the_buffers_floor(rho, kappa):
    """Exactly if kappa / (1 - rho) >= ln(2 V(0) / buffer^2) / ln(e / r)."""
    most = FLOOR * (np.e / MIN_REMAINING) ** exponent(rho, kappa)
    assert exponent(rho, kappa) == pytest.approx(
        np.log(most / FLOOR) / np.log(np.e / MIN_REMAINING)
    )
    assert decayed(0.99 * most, rho, kappa) < FLOOR < decayed(1.01 * most, rho, kappa)


def test_figures_of_the_floored_gain():
    """What docs/theory.md quotes: V(0) up to which buffer 0.02 pays, and what small rho leaves."""
    most = {rates: FLOOR * (np.e / MIN_REMAINING) ** exponent(*rates) for rates in RATES}
    assert most[0.05, 1.0] == pytest.approx(0.073, abs=5e-4)
    assert most[0.25, 1.0] == pytest.approx(0.35, abs=5e-3)
    assert most[0.5, 1.0] == pytest.approx(14.8, abs=0.05)
    assert most[0.75, 1.15] == pytest.approx(3.2e7, rel=0.02)
    assert decayed(1.0, 0.05, 1.0) == pytest.approx(0.00274, abs=5e-6)


def test_where_the_floored_gain_does_not_suffice_the_acceptance_limit_says_so():
    """The limit decays with the true R and kappa = 1; the rows ask for less once R is below its floor."""
    rho, start = 0.05, 1.0
    for kappa, since in ((1.0, 0.995), (1.15, 1 - 1e-4)):
        for tau in np.linspace(since, 1.0, 5)[1:]:
            assert remaining(tau) < MIN_REMAINING
            limit = max(start * remaining(tau) ** (1 / (1 - rho)), FLOOR)
            assert decayed(start, rho, kappa, to=tau) > limit
        early = 0.9
        limit = start * remaining(early) ** (1 / (1 - rho))
        assert decayed(start, rho, kappa, to=early) <= limit * (1 + 1e-6)


# Three rows of one agent.


compiled = jax.jit(effective_directions, static_argnums=1)


def directions(ell):
    """Effective directions of one agent, in float64."""
    with jax.enable_x64(True):
        return np.asarray(compiled(jnp.asarray(ell)[:, None]))[:, 0]


def weights(ell, other):
    """Adaptive weights of the first row between two agents."""
    square = [np.sum(directions(each)[0] ** 2) for each in (ell, other)]
    return np.array(square) / sum(square)


def test_effective_directions_of_three_rows_jump_where_two_others_are_opposed():
    """{d : d_y >= 0, sin(t) d_x >= cos(t) d_y} is a wedge about +x for t > 0 and about -x for t < 0."""
    other = np.array(
        [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    )  # nothing opposed: all of its row is effective

    def at(angle):
        return np.array([[-1.0, 0.0], [0.0, 1.0], [np.sin(angle), -np.cos(angle)]])

    for angle in (1e-3, 1e-6, 1e-9):
        before, after = directions(at(-angle))[0], directions(at(angle))[0]
        np.testing.assert_allclose(before, [-1.0, 0.0], atol=2 * angle)
        np.testing.assert_allclose(after, 0.0, atol=1e-12)
        np.testing.assert_allclose(weights(at(-angle), other), 0.5, atol=2 * angle)
        np.testing.assert_allclose(weights(at(angle), other), [0.0, 1.0], atol=1e-12)


def projected(row, others):
    """The point of {d : others @ d >= 0} nearest to a row, by Moreau: what nonnegative multiples of the others leave."""
    return row + others.T @ nnls(others.T, -row)[0]


def test_effective_directions_are_continuous_where_the_others_cone_has_an_interior():
    """Random rows with `others @ s > 0` for some s, among them nearly opposed ones; steps of 1e-2 to 1e-8."""
    rng = np.random.default_rng(0)
    found = 0
    while found < 200:
        ell = rng.normal(size=(3, 3))
        if found % 2:  # others at an angle of pi - 0.2
            ell[2] = -ell[1] / np.linalg.norm(ell[1]) + 0.2 * rng.normal(size=3)
        others = ell[1:] / np.linalg.norm(ell[1:], axis=1, keepdims=True)
        inside = others.sum(axis=0)  # of two rows that are not opposed
        if np.min(others @ inside) < 1e-2:
            continue
        found += 1
        here, push = directions(ell)[0], rng.normal(size=ell.shape)
        np.testing.assert_allclose(here, projected(ell[0], ell[1:]), atol=1e-7)
        moved = [np.linalg.norm(directions(ell + h * push)[0] - here) for h in (1e-2, 1e-5, 1e-8)]
        assert moved[2] < 1e-4 * (1 + np.linalg.norm(ell[0]))
        assert moved[2] <= moved[1] + 1e-7


def test_a_direction_depends_on_which_way_the_other_row_vanishes():
    """Of two rows, too: along ell_2 = h e with e opposed to ell_1 nothing is left, along h (-e) all of it."""
    one = np.array([1.0, 0.0])
    for size in (1.0, 1e-3, 1e-6):
        np.testing.assert_allclose(directions(np.array([one, -size * one]))[0], 0.0, atol=1e-12)
        np.testing.assert_allclose(directions(np.array([one, size * one]))[0], one, atol=1e-12)


# The blend of phi_delta.


@pytest.mark.parametrize("delta", [0.02, 0.1, 0.3, 0.5, 0.9])
def test_by_how_much_the_square_of_a_blended_direction_exceeds_its_product_with_the_row(delta):
    """|d|^2 - ell . d = |ell|^2 phi (phi - eta), in [0, 9 delta^2 / 256], greatest at eta = 0; zero outside the blend."""
    eta = np.unique(np.concatenate([np.linspace(-1, 1, 4001), np.linspace(-delta, delta, 8001)]))[
        1:
    ]
    first = np.broadcast_to([3.0, 0.0], (len(eta), 2))
    second = 5.0 * np.stack([eta, np.sqrt(1 - eta**2)], axis=-1)
    with jax.enable_x64(True):
        ell = jnp.asarray(np.stack([first, second]))
        d = np.asarray(compiled(ell, delta))[0]
        blend = np.asarray(phi(jnp.asarray(eta), delta))
    square, along = np.sum(d**2, axis=-1), d @ first[0]
    excess = (square - along) / 9
    np.testing.assert_allclose(excess, blend * (blend - eta), atol=1e-12)
    assert np.all(excess >= -1e-12)
    np.testing.assert_allclose(excess[np.abs(eta) >= delta], 0.0, atol=1e-12)
    # (1 - s^2)^3 (9 - s^2) / 256 with s = eta / delta is even and greatest in the middle.
    s = np.clip(eta / delta, -1, 1)
    np.testing.assert_allclose(excess, delta**2 * (1 - s**2) ** 3 * (9 - s**2) / 256, atol=1e-12)
    assert np.max(excess) == pytest.approx(9 * delta**2 / 256, rel=1e-6)
    ratio = square[along > 1e-6] / along[along > 1e-6]
    most = 1 + 9 * delta**2 / 256
    assert most * (1 - 1e-9) <= np.max(ratio) <= 1 + (most - 1) / (1 - delta**2)


def test_figures_of_the_blend():
    """Inside the blend |phi| comes up to delta, and for eta > 0 what is missing is more than phi^2."""
    delta = 0.02
    eta = np.linspace(-delta, delta, 4001)[1:-1]
    with jax.enable_x64(True):
        blend = np.asarray(phi(jnp.asarray(eta), delta))
    assert np.max(np.abs(blend)) > 0.99 * delta > 3 * delta / 16
    assert np.max(blend * (blend - eta) - blend**2) > 0.02 * delta**2
    assert 9 * delta**2 / 256 / (1 - delta**2) == pytest.approx(1.407e-5, abs=5e-9)
