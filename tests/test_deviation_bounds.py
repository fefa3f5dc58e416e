"""Bounds on deviation by quadrature, by the recursion of Euler's scheme, and along samples that it makes."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import quad

from deggflow.deviation import log_bound
from deggflow.deviation.bound import log_held_bound, log_secant_bound


def test_the_bound_is_the_integral():
    """L(r) = 1 + 4 r and |Gamma(s)| = 1 + sin(5 s), on a grid and by adaptive quadrature."""
    tau = np.linspace(0.0, 1.0, 2001)
    lipschitz, correction = 1 + 4 * tau, 1 + np.sin(5 * tau)
    exact, _ = quad(lambda s: np.exp(3 - s - 2 * s**2) * (1 + np.sin(5 * s)), 0, 1)
    assert log_bound(tau, correction, lipschitz) == pytest.approx(np.log(exact), abs=1e-6)
    assert log_held_bound(tau, correction, lipschitz) == pytest.approx(np.log(exact), abs=5e-3)


def test_the_held_bound_is_the_recursion():
    rng = np.random.default_rng(0)
    tau = np.sort(np.append(rng.uniform(size=20), [0.0, 1.0]))
    correction, lipschitz = rng.uniform(0, 3, size=(2, 4, 22))
    gap = np.zeros(4)
    for k, step in enumerate(np.diff(tau)):
        gap = (1 + step * lipschitz[:, k]) * gap + step * correction[:, k]
    np.testing.assert_allclose(log_held_bound(tau, correction, lipschitz), np.log(gap))


class Part(NamedTuple):
    """What nominal and guided Euler samples of one field leave behind, step by step."""

    gap: np.ndarray  # (samples,): |Delta(1)|
    correction: np.ndarray  # (samples, points): |Gamma|
    secant: np.ndarray
    quotient: np.ndarray


def euler_pairs(field, tau, start, push):
    """Nominal and guided samples by Euler's scheme in float64; pushes point where they like."""
    y, z, found = start.copy(), start.copy(), []
    for k, step in enumerate(np.diff(tau)):
        parted, gap = field(tau[k], z) - field(tau[k], y), z - y
        square = np.sum(gap**2, axis=-1)
        safe = np.where(
            square > 0, square, 1.0
        )  # at first the two are one, and grow by the push alone
        found.append(
            (
                np.linalg.norm(push[:, k], axis=-1),
                np.sum(gap * parted, axis=-1) / safe,
                np.linalg.norm(parted, axis=-1) / np.sqrt(safe),
            )
        )
        y, z = y + step * field(tau[k], y), z + step * (field(tau[k], z) + push[:, k])
    correction, secant, quotient = np.array([*found, found[-1]]).transpose(1, 2, 0)
    return Part(np.linalg.norm(z - y, axis=-1), correction, secant, quotient)


def turning(rate, damping=0.0):
    matrix = np.array([[-damping, -rate], [rate, -damping]])
    return lambda tau, x: x @ matrix.T


def stiff(tau, x):
    """Relaxes onto a moving curve so fast that every Euler step of 1/50 overshoots."""
    return np.stack(
        [1.5 * np.sin(x[:, 1]), -130.0 * (x[:, 1] - np.cos(3 * tau + x[:, 0]))], axis=-1
    )


def random_network(seed):
    rng = np.random.default_rng(seed)
    inner, outer = rng.normal(size=(9, 2)) * 2, rng.normal(size=(2, 9)) * 2
    return lambda tau, x: np.tanh(x @ inner.T + 4 * tau) @ outer.T


FIELDS = {
    "turning": turning(20.0),
    "spiral": turning(20.0, damping=3.0),
    "stiff": stiff,
    **{f"network {seed}": random_network(seed) for seed in range(6)},
}


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("power", [1.0, 2.0])
def test_the_secant_bound_bounds_euler_samples(name, power):
    """|Delta(1)| of 50 Euler steps, sample by sample, and never more than the quotients alone would allow."""
    rng = np.random.default_rng(7)
    tau = 1 - (1 - np.linspace(0.0, 1.0, 51)) ** power
    start, push = rng.normal(size=(40, 2)), rng.normal(size=(40, 50, 2))
    push *= (rng.uniform(size=(40, 50)) < 0.2)[..., None]  # now and then
    made = euler_pairs(FIELDS[name], tau, start, push)
    log = log_secant_bound(tau, made.correction, made.secant, made.quotient)
    assert np.all(np.log(made.gap) <= log + 1e-9)
    assert np.all(log <= log_held_bound(tau, made.correction, made.quotient) + 1e-9)


@pytest.mark.parametrize("name", ["turning", "stiff"])
def test_the_integral_of_secants_does_not_bound_euler_samples(name):
    """One push in the first step, then 49 steps: exp(int m) forgets that each of them stretches the gap."""
    tau, push = np.linspace(0.0, 1.0, 51), np.zeros((1, 50, 2))
    push[0, 0] = 1.0, 0.3
    made = euler_pairs(FIELDS[name], tau, np.array([[0.4, -0.2]]), push)
    first = made.correction[:, 0] / 50
    held = first * np.exp(np.sum(made.secant[:, 1:50], axis=-1) / 50)
    integral = np.exp(log_bound(tau, made.correction, made.secant))
    assert made.gap > 30 * np.maximum(held, integral)
    if name == "turning":  # sqrt(1 + h^2 q^2) in every step
        assert made.gap / first == pytest.approx((1 + 0.4**2) ** (49 / 2))
        assert made.gap / first == pytest.approx(38, abs=0.1)
    # One push at the start has one direction: the recursion is exact.
    log = log_secant_bound(tau, made.correction, made.secant, made.quotient)
    np.testing.assert_allclose(log, np.log(made.gap), atol=1e-9)


def test_a_step_that_brings_two_samples_together_leaves_what_is_pushed_after():
    """f = -x / h in the second of three steps."""
    tau, correction = np.linspace(0.0, 1.0, 4), np.array([5.0, 2.0, 1.0, 9.0])
    rate = np.array([0.0, -3.0, 0.0, 0.0])
    found = log_secant_bound(tau, correction, rate, np.abs(rate))
    assert np.exp(found) == pytest.approx((2.0 + 1.0) / 3)
    assert log_secant_bound(tau, np.array([5.0, 0, 0, 0]), rate, np.abs(rate)) == -np.inf


def test_bounds_beyond_any_float_have_a_logarithm():
    tau = np.linspace(0.0, 1.0, 101)
    steep = np.full(101, 1e4)
    only_first = np.eye(101)[0]
    assert log_bound(tau, only_first, steep) == pytest.approx(1e4 + np.log(0.005))
    assert log_bound(tau, np.zeros(101), steep) == -np.inf
