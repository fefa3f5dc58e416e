"""What guidance adds along coupled samples, against the theorem's bounds; norms by dense Jacobians, decoders by their matrices."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

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
    bounds,
    couple,
    decoder_lipschitz,
    growth,
    squared_distances,
    wasserstein,
)
from deggflow.guidance import AbstractGuidance
from deggflow.tasks.bridge.codec import decode, spline_matrix, team_shares
from deggflow.tasks.bridge.condition import BridgeCondition, Scales
from deggflow.tasks.bridge.motion import contact_velocity

AGENTS, DIM, BUFFER = 3, 2, 0.05
SIZE = AGENTS * DIM
MANY = 40  # steps of power iteration after which it has converged


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
