"""The finite-horizon theorem for SE guidance, its rows and what is reported where its conditions fail."""

from functools import cache, partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import DecoupledGuidance, NoGuidance, generate, refined_grid
from deggflow.guidance import (
    AbstractBound,
    AdaptiveShares,
    EqualShares,
    FixedShares,
    Recovering,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
)

AGENTS, DIM, INPUTS = 5, 4, 5
NEAR, BELOW = [0, 1, 2], [1, 2, 3]  # agents of the two factors; agent 4 is in none
RATE = 2.5
SHARES = np.array([[0.2, 0.3, 0.5, 0.0, 0.0], [0.0, 0.5, 0.25, 0.25, 0.0]])


class Decaying(AbstractBound):
    """A bound of one's own: (q(z(0)) + 0.1) e^(-2.5 tau) if that is positive, else level."""

    def init(self, value, condition):
        return value + 0.1

    def __call__(self, state, tau):
        return jnp.where(state > 0, state * jnp.exp(-RATE * tau), state)


class Case(NamedTuple):
    """What a random sample is conditioned on."""

    path: object  # where the centre of the first factor drifts to
    normal: object  # of the second factor's half-space
    swirl: object  # of the field
    kind: object  # which field


def near(tau, z, condition):
    """Mean square distance to a drifting point in the first two coordinates, at most 1."""
    return jnp.mean(jnp.sum((z[:3, :2] - tau * condition.path[None]) ** 2, axis=-1)) - 1.0


def below(tau, z, condition):
    """Smooth maximum of n . z_i + 0.4 sin(4 tau), at most 0."""
    height = z[1:4] @ condition.normal + 0.4 * jnp.sin(4 * tau)
    return jax.nn.logsumexp(6.0 * height) / 6.0


def belongs(agents):
    return lambda condition: jnp.zeros(AGENTS, bool).at[jnp.array(agents)].set(True)


GAINS = np.array([8.0, 1.0])  # of alpha(s) = gain s
FACTORS = (
    SharedFactor(near, alpha=lambda s: 8.0 * s, incidence=belongs(NEAR), name="near"),
    SharedFactor(below, Decaying(), incidence=belongs(BELOW), name="below"),
)
network = eqx.nn.MLP(AGENTS * DIM + 1, AGENTS * DIM, 32, 2, key=jax.random.key(7))


def field(tau, z, condition):
    """By the case: one that fights both factors, an untrained network, a storm that turns with tau."""
    ahead = 3.0 * (2.0 * condition.normal[None] - z) + jnp.tanh(z @ condition.swirl)
    weights, rest = eqx.partition(network, eqx.is_array)
    untrained = eqx.combine(jax.tree.map(lambda x: x.astype(z.dtype), weights), rest)
    learned = 8.0 * untrained(jnp.concatenate([z.reshape(-1), tau[None]])).reshape(z.shape)
    storm = 4.0 * jnp.sin(7.0 * tau + z @ condition.swirl)
    return jnp.stack([ahead, learned, storm])[condition.kind]


KINDS = ("fighting", "untrained network", "storm")


def control(tau, z, condition):
    """A different map for every agent, with more inputs than states, that changes along the way."""
    base = jnp.eye(DIM, INPUTS)[None] + 0.2 * jax.random.normal(
        jax.random.key(1), (AGENTS, DIM, INPUTS)
    )
    return base * (1 + 0.3 * jnp.tanh(z[:, :1, None])) + 0.1 * tau


def guidance(sharing=None, mapped=False):
    requirements = SharedRequirements(FACTORS, AdaptiveShares() if sharing is None else sharing)
    return DecoupledGuidance((requirements,), control if mapped else None)


def _unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def cases(count, seed):
    """Starting points and conditions, in turn of all kinds.

    The half-space is inclined to the first two coordinates: an agent's two rows may work against each other,
    as their cosine is anything in [-0.6, 0.6], but are never opposed. (Where rows come close to that, inputs
    grow without limit, and steps of any size overshoot: the theorem is of inputs that exist.)
    """
    rng = np.random.default_rng(seed)
    one, two, path = (_unit(rng.normal(size=(count, 2))) for _ in range(3))
    return rng.normal(size=(count, AGENTS, DIM)) * 1.5, Case(
        0.7 * path,
        np.concatenate([0.6 * one, 0.8 * two], axis=-1),
        rng.normal(size=(count, DIM, DIM)),
        np.arange(count) % len(KINDS),
    )


def factors_by_hand(tau, z, case):
    """q of both factors along paths of points (points, agents, dim)."""
    centre = tau[:, None, None] * case.path
    mean = ((z[:, NEAR, :2] - centre) ** 2).sum(-1).mean(-1) - 1
    height = z[:, BELOW] @ case.normal + 0.4 * np.sin(4 * tau)[:, None]
    top = height.max(-1)
    return np.stack([mean, top + np.log(np.exp(6 * (height - top[:, None])).sum(-1)) / 6], -1)


def bounds_by_hand(tau, start):
    """beta of both factors from q(0, z(0))."""
    profile = 1 - 6 * tau**5 + 15 * tau**4 - 10 * tau**3
    decay = np.exp(-RATE * tau) if start[1] + 0.1 > 0 else np.ones_like(tau)
    return np.stack([(start[0] + 0.02) * profile, (start[1] + 0.1) * decay], -1)


class Run(NamedTuple):
    """Along trajectories: factors, bounds, and in which samples the theorem's conditions held throughout."""

    q: np.ndarray  # (samples, points, factors)
    beta: np.ndarray
    held: np.ndarray
    kind: np.ndarray
    path: np.ndarray
    trace: object


SAMPLES = 24


COARSE, FINE = 100, 400


@jax.jit
@partial(jax.vmap, in_axes=(0, 0, None))
def trajectory(z0, condition, grid):
    """Under heterogeneous control maps."""
    return generate(field, guidance(mapped=True), z0, condition, grid=grid, keep_path=True)


@cache
def run(steps):
    """Even steps; the grid is filled up with steps of length zero, so that it is compiled once."""
    start, case = cases(SAMPLES, 11)
    tau = np.minimum(np.arange(FINE + 1) / steps, 1.0)
    with jax.enable_x64(True):
        out = trajectory(*jax.tree.map(jnp.asarray, (start, case, tau)))
        path, trace = np.asarray(out.path), jax.tree.map(np.asarray, out.trace)
    each = [jax.tree.map(lambda leaf, k=k: leaf[k], case) for k in range(SAMPLES)]
    q = np.array([factors_by_hand(tau, z, c) for z, c in zip(path, each, strict=True)])
    beta = np.array([bounds_by_hand(tau, one[0]) for one in q])
    taken = tau[:-1] < 1
    held = trace.able[:, taken].all((1, 2, 3)) & ~trace.infeasible[:, taken].any((1, 2))
    return Run(q, beta, held, case.kind, path, trace)


@pytest.mark.parametrize("kind", range(3), ids=KINDS)
def test_factors_stay_under_their_bounds_along_the_trajectory(kind):
    """thm:SE_finite_horizon, which is of continuous time: what Euler steps add vanishes with them."""
    coarse, fine = run(COARSE), run(FINE)
    chosen = (coarse.kind == kind) & coarse.held & fine.held
    assert chosen.sum() >= 5
    above = [(one.q - one.beta)[chosen].max() for one in (coarse, fine)]
    assert above[1] <= max(above[0] / 3, 1e-9)
    assert above[1] <= 0.02


def test_the_end_satisfies_the_requirement():
    """beta(1) = 0 implies q(1, z(1)) <= 0, up to what Euler steps add."""
    coarse, fine = run(COARSE), run(FINE)
    chosen = coarse.held & fine.held
    end = [max(one.q[chosen, -1, 0].max(), 0.0) for one in (coarse, fine)]
    assert end[1] <= max(end[0] / 3, 1e-9)
    assert np.mean(fine.q[chosen, 0, 0] > 0) > 0.5  # it was broken before


def test_without_guidance_the_same_fields_break_the_bounds():
    start, case = cases(SAMPLES, 11)

    @jax.jit
    @jax.vmap
    def nominal(z0, condition):
        z = generate(field, NoGuidance(), z0, condition, grid=refined_grid(100)).z
        one = jnp.ones(())
        return jnp.stack([near(one, z, condition), below(one, z, condition)])

    with jax.enable_x64(True):
        end = np.asarray(nominal(jnp.asarray(start), jax.tree.map(jnp.asarray, case)))
    for kind in range(3):
        assert np.all(end[case.kind == kind].max(axis=0) > 0.2)


def test_the_trace_is_the_factors_and_their_bounds():
    one = run(COARSE)
    np.testing.assert_allclose(one.trace.value, one.q[:, :-1], atol=1e-9)
    np.testing.assert_allclose(one.trace.bound, one.beta[:, :-1], atol=1e-9)
    assert guidance().names == ("near", "below")


def test_an_agent_of_no_factor_never_acts():
    one = run(COARSE)
    assert np.all(one.trace.effort[..., 4] == 0)
    assert np.all(one.trace.able[..., 4])
    assert not one.trace.infeasible[..., 4].any()


class Moment(NamedTuple):
    """The guidance at random states, tau and drifts; slopes by central differences of the factors."""

    ell: np.ndarray
    b: np.ndarray
    correction: np.ndarray
    report: object
    slope: np.ndarray  # dq/dtau along drift + correction
    free: np.ndarray  # dq/dtau along the drift alone
    dbeta: np.ndarray
    room: np.ndarray  # q - beta
    changed: np.ndarray  # correction where another agent has another drift


# Sharing, and whether the control maps are heterogeneous, else the identity.
SHARINGS = {
    "adaptive": (AdaptiveShares, True),
    "equal": (EqualShares, False),
    "fixed": (lambda: FixedShares(jnp.asarray(SHARES)), False),
}


@cache
def moments(name, count=60):
    sharing, mapped = SHARINGS[name]
    start, case = cases(count, 5)
    rng = np.random.default_rng(6)
    z = start + rng.normal(size=start.shape)
    drift, times = 3 * rng.normal(size=start.shape), rng.uniform(0.01, 0.99, count)
    other = drift.copy()
    other[:, 1] += 1.0

    @jax.jit
    @jax.vmap
    def at(z0, z, tau, drift, condition):
        guide = guidance(sharing(), mapped)
        state = guide.init(z0, condition)
        g = control(tau, z, condition) if mapped else None
        rows = guide.requirements[0].rows(state[0], tau, z, drift, g, condition)
        return rows.ell, rows.b, *guide(state, tau, z, drift, condition)

    def evaluated(drift):
        inputs = jax.tree.map(jnp.asarray, (start, z, times, drift, case))
        return jax.tree.map(np.asarray, at(*inputs))

    with jax.enable_x64(True):
        ell, b, correction, report = evaluated(drift)
        changed = evaluated(other)[2]

    def q(s, velocity):
        return each(times + s, z + s * velocity, lambda k: jax.tree.map(lambda leaf: leaf[k], case))

    def each(tau, z, of):
        return np.array(
            [factors_by_hand(tau[k : k + 1], z[k : k + 1], of(k))[0] for k in range(count)]
        )

    first = each(0 * times, start, lambda k: jax.tree.map(lambda leaf: leaf[k], case))

    def beta(s):
        return np.array([bounds_by_hand(times[k : k + 1] + s, first[k])[0] for k in range(count)])

    def difference(of, h=1e-6):
        return (of(h) - of(-h)) / (2 * h)

    return Moment(
        ell,
        b,
        correction,
        report,
        difference(lambda s: q(s, drift + correction)),
        difference(lambda s: q(s, drift)),
        difference(beta),
        q(0.0, drift) - beta(0.0),
        changed,
    )


@pytest.mark.parametrize("name", SHARINGS)
def test_rows_together_imply_the_decay_of_the_factor(name):
    """dq/dtau <= dbeta/dtau - alpha(q - beta) along drift and correction (paper, eqn:app_SE_global_decay)."""
    one = moments(name)
    # Inputs of another order of magnitude are those of rows that are nearly opposed, or nearly zero.
    good = (
        ~one.report.infeasible.any(1)
        & one.report.able.all((1, 2))
        & (one.report.effort.max(1) < 1e3)
    )
    assert good.sum() >= 20
    limit = one.dbeta - GAINS * one.room
    assert np.all((one.slope - limit)[good] <= 1e-4)
    assert np.mean(one.free[good] > limit[good]) > 0.2  # the drift alone does not


@pytest.mark.parametrize("name", SHARINGS)
def test_offsets_of_a_factor_add_up(name):
    """sum_i b_i = grad q . f + dq/dtau - dbeta/dtau + alpha(q - beta), partial tau of q included."""
    one = moments(name)
    np.testing.assert_allclose(one.b.sum(-1), one.free - one.dbeta + GAINS * one.room, atol=1e-5)


@pytest.mark.parametrize("name", ["adaptive", "equal"])
def test_rows_of_agents_outside_a_factor_are_zero(name):
    one = moments(name)
    outside = np.ones((2, AGENTS), bool)
    outside[0, NEAR], outside[1, BELOW] = False, False
    assert np.all(one.ell[:, outside] == 0)
    assert np.all(one.b[:, outside] == 0)
    assert np.all(one.correction[:, 4] == 0)


def test_incidence_alone_decides_who_acts():
    """Though the second agent could bring the factor down as well, and is drawn in no factor."""
    factor = SharedFactor(
        lambda tau, z, condition: jnp.sum(z), incidence=lambda c: jnp.array([True, False])
    )
    requirements = SharedRequirements((factor,))

    @jax.jit
    def at(z, drift):
        state, tau = requirements.init(z, None), jnp.asarray(0.5)
        guide = DecoupledGuidance((requirements,))
        rows = requirements.rows(state, tau, z, drift, None, None)
        return rows.ell, rows.b, guide((state,), tau, z, drift, None)[0]

    ell, b, u = at(jnp.ones((2, 2)), jnp.array([[1.0, 1.0], [0.0, 0.0]]))
    assert np.all(ell[:, 1] == 0)
    assert np.all(b[:, 1] == 0)
    assert np.all(u[1] == 0)
    assert np.all(u[0] < 0)


@pytest.mark.parametrize("name", SHARINGS)
def test_an_agents_input_knows_no_other_agents_drift(name):
    """Decoupled: with another drift of agent 1, the others' inputs are the same to the bit."""
    one = moments(name)
    others = np.arange(AGENTS) != 1
    np.testing.assert_array_equal(one.changed[:, others], one.correction[:, others])
    assert np.mean(np.any(one.changed[:, 1] != one.correction[:, 1], axis=-1)) > 0.5


def test_the_change_of_a_factor_by_itself_enters():
    """q = z + 3 sin(5 tau) rises and falls by itself; without drift the agent has to make up for it."""
    factor = SharedFactor(lambda tau, z, condition: z[0, 0] + 3.0 * jnp.sin(5.0 * tau))
    guide = DecoupledGuidance((SharedRequirements((factor,)),))
    out = jax.jit(
        lambda z0: generate(lambda tau, z, c: 0.0 * z, guide, z0, None, grid=refined_grid(400, 1.0))
    )(jnp.full((1, 1), 0.5))
    assert jnp.max(out.trace.value - out.trace.bound) <= 0.02
    end = float(out.z[0, 0]) + 3 * np.sin(5.0)
    assert end <= 0.01
    assert float(jnp.max(out.trace.effort)) > 5.0


def one_sided(tau, z, condition):
    """Two agents share it; only the first can change it."""
    return z[0, 0] + 0.0 * z[1, 0]


def upward(tau, z, condition):
    return jnp.ones_like(z)


def test_shares_that_ask_an_agent_for_what_it_cannot_give_are_reported():
    """Equal and fixed shares are infeasible where adaptive ones leave every agent an input."""
    sharings = (AdaptiveShares(), EqualShares(), FixedShares(jnp.array([[0.3, 0.7]])))

    @jax.jit
    def traces(z0):
        guides = [
            DecoupledGuidance((SharedRequirements((SharedFactor(one_sided),), s),))
            for s in sharings
        ]
        return [generate(upward, guide, z0, None).trace for guide in guides]

    adaptive, *rigid = traces(jnp.ones((2, 2)))
    for trace in rigid:
        assert not trace.able[:, 0, 1].all()
        np.testing.assert_array_equal(trace.infeasible[:, 1], ~trace.able[:, 0, 1])
        assert not trace.infeasible[:, 0].any()
        assert trace.value[-1, 0] > trace.bound[-1, 0]  # and the bound is in fact missed
    assert adaptive.able.all()
    assert not adaptive.infeasible.any()
    assert jnp.max(adaptive.value - adaptive.bound) <= 0.01


def test_rows_exactly_opposed_at_one_agent_are_reported():
    """q_1 = z_0 and q_2 = -z_0 both have to fall: no input does, nobody else can help."""
    factors = tuple(
        SharedFactor(lambda tau, z, condition, s=s: s * (z[0, 0] - 2.0) + 1.0, name=name)
        for s, name in ((1.0, "down"), (-1.0, "up"))
    )
    guide = DecoupledGuidance((SharedRequirements(factors),))
    still = jax.jit(lambda z0: generate(lambda tau, z, c: 0.0 * z, guide, z0, None))
    out = still(jnp.full((3, 2), 2.0))
    middle = (out.trace.tau > 0.2) & (out.trace.tau < 0.8)
    assert jnp.all(out.trace.infeasible[middle, 0])
    assert not jnp.any(out.trace.able[middle, :, 0])
    assert jnp.all(jnp.isfinite(out.z))


def test_one_requirement_stated_twice_asks_for_the_same_input():
    """eta = 1 and d = l: the proposition's conditions hold; u_i = -max(b_i, 0) l_i / |l_i|^2."""
    start, case = cases(SAMPLES, 2)
    twice = SharedRequirements(FACTORS[:1] * 2)

    @jax.jit
    @jax.vmap
    def at(z, condition):
        guide, tau = DecoupledGuidance((twice,)), jnp.asarray(0.4)
        state, drift = guide.init(z, condition), 3.0 * jnp.sin(5.0 * z)
        rows = twice.rows(state[0], tau, z, drift, None, condition)
        return rows.ell[0], rows.b[0], *guide(state, tau, z, drift, condition)

    ell, b, u, report = at(*jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (start, case)))
    assert not report.infeasible.any()
    square = np.where(np.sum(ell**2, -1) > 0, np.sum(ell**2, -1), 1.0)
    expected = -np.maximum(b, 0)[..., None] * ell / square[..., None]
    np.testing.assert_allclose(u, expected, atol=1e-4 * np.abs(expected).max())


def test_a_recovering_alpha_is_of_extended_class_k():
    """Zero at zero, increasing, and alpha(s) = s where q is below its bound."""
    alpha = Recovering(30.0)
    s = np.linspace(-2, 2, 101)
    value = np.asarray(jax.vmap(alpha)(jnp.asarray(s)))
    assert alpha(jnp.zeros(())) == 0
    assert np.all(np.diff(value) > 0)
    np.testing.assert_allclose(value[s <= 0], s[s <= 0], atol=1e-6)
    np.testing.assert_allclose(value[s > 0], 30 * s[s > 0], rtol=1e-5)


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan")])
def test_a_gain_that_is_not_positive_is_refused(gain):
    with pytest.raises(ValueError, match=f"`gain` must be positive.* got {gain}"):
        Recovering(gain)


def test_a_recovering_alpha_makes_good_what_lands_above_the_bound():
    """Started above the bound (slack 0 and a jump), V decays at the gain's rate instead of at 1."""

    def last(alpha):
        factor = SharedFactor(one_sided, TighteningBound(), alpha=alpha)
        guide = DecoupledGuidance((SharedRequirements((factor,)),))
        state = guide.init(jnp.zeros((2, 2)), None)  # the bound of another, better start

        def step(z, tau):
            correction, report = guide(state, tau, z, upward(tau, z, None), None)
            return z + (upward(tau, z, None) + correction) / 400, report.value - report.bound

        _, excess = jax.lax.scan(step, jnp.ones((2, 2)), jnp.arange(400) / 400)
        return np.asarray(excess)[:, 0]

    slow, fast = last(lambda s: s), last(Recovering(20.0))
    times = np.arange(400) / 400
    np.testing.assert_allclose(slow, slow[0] * np.exp(-times), atol=0.01)
    assert np.all(fast <= fast[0] * np.exp(-20 * times) + 0.01)
