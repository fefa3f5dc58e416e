"""Distances by trying all permutations, bounds by quadrature and along trajectories, norms by dense Jacobians."""

from itertools import permutations
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import t

from deggflow import (
    HEUN,
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    StepGuard,
    generate,
    refined_grid,
)
from deggflow.deviation import (
    assignment,
    bounds,
    couple,
    decoder_lipschitz,
    growth,
    log_bound,
    measure,
    squared_distances,
    wasserstein,
)
from deggflow.deviation.bound import log_held_bound, log_secant_bound
from deggflow.guidance import AbstractGuidance
from deggflow.tasks.bridge.codec import decode, spline_matrix, team_shares
from deggflow.tasks.bridge.condition import BridgeCondition, Scales
from deggflow.tasks.bridge.motion import contact_velocity

AGENTS, DIM, BUFFER = 3, 2, 0.05
SIZE = AGENTS * DIM
MANY = 40  # steps of power iteration after which it has converged


def matrices(nominal, guided):
    pairs = (nominal, guided), (nominal, nominal), (guided, guided)
    return [squared_distances(a, b) for a, b in pairs]


def best_of_all(cross):
    """Least mean of squared distances over all permutations, and where it is reached."""
    rows = np.arange(len(cross))
    return min((cross[rows, list(p)].mean(), p) for p in permutations(rows))


@pytest.mark.parametrize("seed", range(4))
def test_the_assignment_is_the_best_of_all_permutations(seed):
    rng = np.random.default_rng(seed)
    nominal, guided = rng.normal(size=(2, 6, AGENTS, DIM))
    cross, near, far = matrices(nominal, guided)
    for m in range(6):
        for n in range(6):
            assert cross[m, n] == pytest.approx(np.sum((nominal[m] - guided[n]) ** 2))
    least, where = best_of_all(cross)
    assert tuple(assignment(cross)) == where
    found = measure(cross, near, far)
    assert found.w2 == pytest.approx(np.sqrt(least)) == wasserstein(cross)
    assert found.paired == pytest.approx(np.sqrt(np.mean((nominal - guided) ** 2) * SIZE))
    assert found.identity == np.mean(np.array(where) == np.arange(6))


def test_figures_worked_out_by_hand():
    """Points 0, 1, 5 on a line; guidance takes 0 to 1 and 1 to 0, and 5 to 8."""
    nominal, guided = (np.array(points).reshape(3, 1, 1) for points in ([0.0, 1, 5], [1.0, 0, 8]))
    found = measure(*matrices(nominal, guided))
    assert found.w2 == pytest.approx(np.sqrt(9 / 3))  # the first two exchange their partners
    assert found.paired == pytest.approx(np.sqrt((1 + 1 + 9) / 3))
    assert found.identity == pytest.approx(1 / 3)
    assert found.spread == pytest.approx(np.sqrt((1 + 25 + 16) / 3))
    assert found.ratio == pytest.approx(np.sqrt(9 / 42))
    assert found.spread_ratio == pytest.approx(np.sqrt((1 + 64 + 49) / 42))


def test_a_shift_is_its_own_distance(key):
    nominal = np.random.default_rng(0).normal(size=(30, AGENTS, DIM))
    found = measure(*matrices(nominal, nominal + 0.3))
    assert found.w2 == pytest.approx(found.paired) == pytest.approx(0.3 * np.sqrt(SIZE))
    assert found.identity == 1
    np.testing.assert_allclose([found.spread_ratio, *found.spread_interval], 1.0)


def test_too_few_samples_are_refused():
    two = np.zeros((2, 2))
    with pytest.raises(ValueError, match="at least 3"):
        measure(two, two, two)


def left_out(nominal, guided, m):
    """Both ratios without pair m, assignment and all."""
    cross, near, far = matrices(*(np.delete(each, m, axis=0) for each in (nominal, guided)))
    return wasserstein(cross) / np.sqrt(near.sum()), np.sqrt(far.sum() / near.sum())


def jackknife(estimate, values):
    count = len(values)
    error = np.sqrt((count - 1) / count * np.sum((values - np.mean(values)) ** 2))
    reach = t(count - 1).ppf(0.975) * error / estimate
    return estimate * np.exp(np.array([-reach, reach]))


@pytest.mark.parametrize(("push", "always_own"), [(0.05, True), (1.5, False)])
def test_intervals_leave_out_one_pair_after_the_other(push, always_own):
    """Exactly where the assignment is the identity; else it is another one without a pair, and costs more."""
    rng = np.random.default_rng(3)
    nominal = rng.normal(size=(25, 2, 1))
    guided = nominal + push * rng.normal(size=nominal.shape) * (0.2 + (nominal > 0))
    found = measure(*matrices(nominal, guided))
    assert (found.identity == 1) == always_own
    ratio, spread_ratio = np.array([left_out(nominal, guided, m) for m in range(25)]).T
    ratio *= np.sqrt(24 * 23)
    np.testing.assert_allclose(found.spread_interval, jackknife(found.spread_ratio, spread_ratio))
    written_out = jackknife(found.ratio, ratio)
    np.testing.assert_allclose(found.ratio_interval, written_out, rtol=1e-9 if always_own else 0.1)


def test_one_sample_that_moved_gives_a_wide_interval():
    nominal = np.random.default_rng(0).normal(size=(20, 1, 3))
    guided = nominal.copy()
    found = measure(*matrices(nominal, guided))
    assert (found.ratio, *found.ratio_interval) == (0.0, 0.0, 0.0)
    guided[3] += 0.1
    low, high = measure(*matrices(nominal, guided)).ratio_interval
    assert high > 10 * low > 0


@pytest.mark.parametrize(("size", "push"), [(8, 0.3), (2, 1.0)])
def test_intervals_cover_the_expected_ratios(size, push):
    """Far apart in eight dimensions each keeps its own; in two the assignment is another one every time."""
    rng = np.random.default_rng(size)

    def sample():
        nominal = rng.normal(size=(40, 1, size))
        return measure(*matrices(nominal, nominal + push * rng.normal(size=nominal.shape)))

    others, found = [sample() for _ in range(600)], [sample() for _ in range(200)]
    assert (np.mean([one.identity for one in found]) > 0.99) == (size == 8)
    for value, interval in (("ratio", "ratio_interval"), ("spread_ratio", "spread_interval")):
        expected = np.mean([getattr(one, value) for one in others])
        low, high = np.array([getattr(one, interval) for one in found]).T
        assert 0.9 <= np.mean((low <= expected) & (expected <= high)) <= 0.985


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


class Pushing(AbstractGuidance):
    """The same push all the time."""

    push: jax.Array

    @property
    def names(self):
        return ()

    def init(self, z0, condition, mask=None):
        return None

    def __call__(self, state, tau, z, drift, condition, moving=None):
        return None, self.push, NoGuidance()(None, tau, z, drift, condition)[2]

    def on_forced_step(self, state, tau, value, above):
        return None


def scaled(tau, z, rate):
    return rate * z


@pytest.mark.parametrize("rate", [1.5, -1.5])
def test_one_growing_number_meets_the_bound(rate, key):
    """f = a z and a push p: Delta(1) = p (e^a - 1) / a; the theorem's L is |a|, the secant's growth a itself.

    On one line the gap has the push's direction: the bound by secants is what Euler's scheme makes of it.
    """
    z0 = jax.random.normal(key, (5, 1, 1))
    pushed = Pushing(jnp.full((1, 1), 0.7))
    coupled = couple(scaled, pushed, z0, jnp.asarray(rate), grid=refined_grid(1000, 1.0))
    found = growth(scaled, coupled, jnp.asarray(rate))
    np.testing.assert_allclose(found.lipschitz, abs(rate), rtol=1e-4)
    gap = np.asarray(coupled.guided - coupled.nominal)[:, -1]
    exact = 0.7 * np.expm1(rate) / rate
    np.testing.assert_allclose(gap, exact, rtol=2e-3)
    limits = bounds(coupled, found)
    assert np.exp(limits.secant) == pytest.approx(float(gap[0, 0, 0]), rel=1e-3)
    assert np.exp(limits.theorem) == pytest.approx(0.7 * np.expm1(1.5) / 1.5, rel=1e-3)
    assert np.exp(limits.held) == pytest.approx(0.7 * np.expm1(1.5) / 1.5, rel=2e-3)


def test_a_symmetric_field_has_its_spectral_norm(key):
    half = np.random.default_rng(0).normal(size=(SIZE, SIZE))
    matrix = jnp.asarray(half + half.T, jnp.float32)
    pushed = Pushing(jnp.ones((AGENTS, DIM)))

    def field(tau, z, condition):
        return (matrix @ z.reshape(-1)).reshape(z.shape) + jnp.cos(tau)

    coupled = couple(field, pushed, jax.random.normal(key, (4, AGENTS, DIM)), None)
    found = growth(field, coupled, None)
    norm = np.linalg.norm(half + half.T, 2)
    np.testing.assert_allclose(found.lipschitz[:, 20:], norm, rtol=1e-3)
    assert np.all(np.asarray(found.lipschitz) <= norm * (1 + 1e-5))
    limits, end = bounds(coupled, found), coupled.guided[:, -1] - coupled.nominal[:, -1]
    paired = np.sqrt(np.mean(np.sum(np.asarray(end) ** 2, axis=(1, 2))))
    exact = np.log(np.sqrt(SIZE) * np.expm1(norm) / norm)
    assert np.log(paired) <= limits.quotient + 1e-3 <= limits.theorem + 2e-3
    assert limits.theorem == pytest.approx(exact, abs=0.05)


class Case(NamedTuple):
    """What a random field is conditioned on."""

    inner: jax.Array
    outer: jax.Array
    control: jax.Array


def random_case(seed):
    rng = np.random.default_rng(seed)
    return Case(
        jnp.asarray(rng.normal(size=(8, SIZE)) * 0.8, jnp.float32),
        jnp.asarray(rng.normal(size=(SIZE, 8)) * 0.8, jnp.float32),
        jnp.asarray(np.eye(DIM) + 0.4 * rng.normal(size=(AGENTS, DIM, DIM)), jnp.float32),
    )


def network(tau, z, case):
    return (case.outer @ jnp.tanh(case.inner @ z.reshape(-1) + 2 * tau)).reshape(z.shape)


def apart(z, case):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


GUIDANCE = DecoupledGuidance(
    (PrivateRequirement(apart, buffer=BUFFER, name="apart"),),
    control=lambda tau, z, case: case.control,
)


@pytest.fixture(scope="module", params=range(2))
def run(request):
    """A random field, a control map of its own for every agent, and six samples."""
    case = random_case(request.param)
    z0 = jax.random.normal(jax.random.key(request.param), (6, AGENTS, DIM)) * 0.7
    return case, z0, couple(network, GUIDANCE, z0, case)


@eqx.filter_jit
def path_of(guidance, z0, case):
    return generate(network, guidance, z0, case, guard=None, keep_path=True).path


def test_pairs_are_what_generate_gives(run):
    case, z0, coupled = run
    for guidance, path in ((NoGuidance(), coupled.nominal), (GUIDANCE, coupled.guided)):
        np.testing.assert_allclose(path[2], path_of(guidance, z0[2], case), atol=2e-5)


def test_the_correction_is_what_the_field_does_not_explain(run):
    """Along Euler steps Gamma = (z' - z) / h - f, whatever g is."""
    case, _, coupled = run
    tau, z = np.asarray(coupled.tau, np.float64), np.asarray(coupled.guided, np.float64)
    drift = jax.vmap(jax.vmap(network, (0, 0, None)), (None, 0, None))(
        coupled.tau, coupled.guided, case
    )
    step = np.diff(tau)
    gamma = np.diff(z, axis=1) / step[None, :, None, None] - np.asarray(drift)[:, :-1]
    rounding = 1e-5 + 3e-6 / step
    error = np.linalg.norm(gamma, axis=(2, 3)) - np.asarray(coupled.correction)[:, :-1]
    assert np.all(np.abs(error) <= rounding[None])
    assert np.max(np.asarray(coupled.correction)) > 0.1


def test_the_theorem_holds_along_random_fields(run):
    """Even if power iteration has hardly begun: the proof's own quotients are among the candidates."""
    case, _, coupled = run
    ends = [np.asarray(path[:, -1]) for path in (coupled.nominal, coupled.guided)]
    cross = squared_distances(*ends)
    paired = np.log(np.sqrt(np.mean(np.diag(cross))))
    assert np.log(wasserstein(cross)) <= paired + 1e-9
    limits = bounds(coupled, growth(network, coupled, case, iterations=1))
    assert paired <= limits.held + 1e-5
    assert paired <= limits.secant + 1e-5
    assert limits.secant <= limits.samples <= limits.held <= limits.theorem
    assert limits.secant <= limits.quotient <= limits.held


def test_norms_are_those_of_dense_jacobians(run):
    """Central differences in float64, at the ends and the middle of the segment between the two states."""
    case, _, coupled = run
    found = growth(network, coupled, case, iterations=MANY)
    inner, outer, _ = (np.asarray(leaf, np.float64) for leaf in case)
    for k in (0, 40, 100):
        tau = float(coupled.tau[k])

        def f(x, tau=tau):
            return np.tanh(x @ inner.T + 2 * tau) @ outer.T

        for m in range(6):
            y, z = (
                np.asarray(p[m, k], np.float64).ravel() for p in (coupled.nominal, coupled.guided)
            )
            h = 1e-5 * np.eye(SIZE)
            dense = [
                np.linalg.norm((f(x[None] + h) - f(x[None] - h)).T / 2e-5, 2)
                for x in (y, (y + z) / 2, z)
            ]
            gap = np.linalg.norm(z - y)
            assert found.lipschitz[m, k] <= max(dense) * (1 + 1e-4)
            assert found.lipschitz[m, k] == pytest.approx(max(dense), rel=1e-3)
            if gap > 0.05:
                parted = f(z) - f(y)
                assert found.quotient[m, k] == pytest.approx(np.linalg.norm(parted) / gap, rel=1e-3)
                secant = parted @ (z - y) / gap**2
                assert found.secant[m, k] == pytest.approx(secant, abs=1e-3)


def test_guarded_steps_and_other_schemes_are_coupled_too():
    case, z0 = random_case(0), jax.random.normal(jax.random.key(0), (6, AGENTS, DIM)) * 0.7
    other = couple(network, GUIDANCE, z0, case, solver=HEUN, guard=StepGuard())
    ends = squared_distances(np.asarray(other.nominal[:, -1]), np.asarray(other.guided[:, -1]))
    limits = bounds(other, growth(network, other, case, iterations=1))
    assert np.log(np.sqrt(np.mean(np.diag(ends)))) <= limits.theorem


def test_a_segment_has_two_ends(run):
    with pytest.raises(ValueError, match="`segment` must be at least 2"):
        growth(network, run[2], run[0], segment=1)


def test_a_linear_decoder_has_its_largest_singular_value(key):
    matrix = np.random.default_rng(0).normal(size=(9, SIZE)).astype(np.float32)

    def decoder(z):
        out = jnp.asarray(matrix) @ z.reshape(-1) + 3.0
        return {"some": out[:4].reshape(2, 2), "rest": out[4:]}

    z = jax.random.normal(key, (AGENTS, DIM))
    assert decoder_lipschitz(decoder, z) == pytest.approx(np.linalg.norm(matrix, 2), rel=1e-5)


def test_a_decoder_that_is_not_linear_has_the_local_one():
    assert decoder_lipschitz(lambda z: z**2, jnp.array([[1.0, -3.0]])) == pytest.approx(6.0)


def test_the_bridge_decoder_is_affine_and_its_constant_known():
    """Velocities are J_B(r_i) (continuation + B sum_j G^-1 M_j diag(scale) eta_j): one matrix for every z."""
    robots, rng = 3, np.random.default_rng(2)
    scale = rng.uniform(0.05, 2.0, 24)
    contacts = np.array([[-2.0, 0.36], [0.4, -0.36], [2.3, 0.36]], np.float32)
    zero, ahead = jnp.zeros(3), jnp.asarray(rng.normal(size=(20, 3)), jnp.float32)
    mask = jnp.ones(robots, bool)
    condition = BridgeCondition(zero, zero, zero, jnp.asarray(contacts), mask, ahead)

    @eqx.filter_jit
    def decoder(z):
        return decode(z, condition, Scales(eta=tuple(scale.tolist())))

    shares = np.asarray(team_shares(jnp.asarray(contacts), mask), np.float64)
    of_twist = np.concatenate(
        [np.asarray(contact_velocity(jnp.eye(3), jnp.asarray(r)[None])).T for r in contacts]
    )
    blocks = [np.kron(spline_matrix(), of_twist @ share) * scale[None] for share in shares]
    exact = np.linalg.norm(np.hstack(blocks), 2)
    z = jax.random.normal(jax.random.key(0), (robots, 24))
    assert decoder_lipschitz(decoder, z) == pytest.approx(exact, rel=1e-4)
