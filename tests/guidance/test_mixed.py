"""Shared and private requirements in one generation, every agent with a control map and a metric of its own."""

from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quadprog
from scipy.optimize import nnls

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    generate,
    refined_grid,
)

AGENTS, DIM, BUFFER = 3, 3, 0.05
GAIN, SLACK = 4.0, 0.02  # alpha(s) = gain s; by which bounds start above q(z(0))
RHO, KAPPA = 0.75, 1.15
CEILING = [0, 1]  # agents of the second factor
network = eqx.nn.MLP(AGENTS * DIM + 1, AGENTS * DIM, 32, 2, key=jax.random.key(7))

_rng = np.random.default_rng(4)
CONTROL = np.eye(DIM) + 0.4 * _rng.normal(size=(AGENTS, DIM, DIM))
ROOT = _rng.normal(size=(AGENTS, DIM, DIM))
METRIC = ROOT @ ROOT.swapaxes(1, 2) + 0.2 * np.eye(DIM)


class Case(NamedTuple):
    """What a random sample is conditioned on."""

    path: object  # where the centre drifts to
    normal: object  # of the ceiling
    swirl: object
    kind: object  # which field


def centre(tau, z, condition):
    """The mean follows a drifting point, within sqrt(0.4)."""
    return jnp.sum((jnp.mean(z, axis=0) - tau * condition.path) ** 2) - 0.4


def ceiling(tau, z, condition):
    """Smooth maximum of n . z_i of two agents, under a ceiling that sinks."""
    return jax.nn.logsumexp(6.0 * (z[:2] @ condition.normal)) / 6.0 - 1.0 + 0.5 * tau


def margins(z, condition):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


FIELDS = ("storm", "untrained network")


def field(tau, z, condition):
    """A storm that turns with tau, or a network that has learnt nothing; both push up and together."""
    weights, rest = eqx.partition(network, eqx.is_array)
    untrained = eqx.combine(jax.tree.map(lambda x: x.astype(z.dtype), weights), rest)
    learned = 8.0 * untrained(jnp.concatenate([z.reshape(-1), tau[None]])).reshape(z.shape)
    storm = 4.0 * jnp.sin(7.0 * tau + z @ condition.swirl)
    together = 3.0 * (jnp.mean(z, axis=0)[None] - z)
    return jnp.stack([storm, learned])[condition.kind] + 2.0 * condition.normal[None] + together


def guidance():
    factors = (
        SharedFactor(centre, alpha=lambda s: GAIN * s, name="centre"),
        SharedFactor(
            ceiling,
            alpha=lambda s: GAIN * s,
            incidence=lambda condition: jnp.arange(AGENTS) < 2,
            name="ceiling",
        ),
    )
    private = PrivateRequirement(margins, BUFFER, rho=RHO, kappa=KAPPA, name="apart")
    return DecoupledGuidance(
        (SharedRequirements(factors), private),
        control=lambda tau, z, condition: jnp.asarray(CONTROL, z.dtype),
        metric=jnp.asarray(METRIC),
    )


def cases(count, seed):
    """Starting points and conditions, in turn of both kinds."""
    rng = np.random.default_rng(seed)
    unit = rng.normal(size=(2, count, DIM))
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    z0 = 1.2 * rng.normal(size=(count, AGENTS, DIM))
    kind = np.arange(count) % len(FIELDS)
    return z0, Case(0.7 * unit[0], unit[1], rng.normal(size=(count, DIM, DIM)), kind)


def values_by_hand(tau, z, case):
    """q of both factors and V along one path."""
    mean = ((z.mean(1) - tau[:, None] * case.path) ** 2).sum(-1) - 0.4
    top = np.log(np.exp(6 * z[:, CEILING] @ case.normal).sum(-1)) / 6 - 1 + 0.5 * tau
    far = np.linalg.norm(z[:, :, None] - z[:, None], axis=-1) + 10 * np.eye(AGENTS)
    return np.stack([mean, top, (np.maximum(BUFFER + 1 - far, 0) ** 2).sum((1, 2)) / 2], -1)


def limits_by_hand(tau, start):
    """beta of both factors, and what V may be: the curve of kappa = 1, or what the buffer pays for."""
    profile = (1 - 10 * tau**3 + 15 * tau**4 - 6 * tau**5)[:, None]
    left = 1 - 0.1 * tau - 0.9 * tau**2
    private = np.maximum(start[2] * left ** (1 / (1 - RHO)), BUFFER**2 / 2)
    return np.concatenate([(start[:2] + SLACK) * profile, private[:, None]], -1)


class Moment(NamedTuple):
    """Rows and inputs at random states, tau and drifts."""

    ell: np.ndarray  # (moments, rows, agents, inputs)
    b: np.ndarray
    zeta: np.ndarray  # b where nothing drifts
    u: np.ndarray  # (moments, agents, inputs)
    infeasible: np.ndarray
    rate: np.ndarray  # change of the values along drift and correction, by central differences
    decay: np.ndarray  # what the theorems allow


TIME = 0.6


@cache
def moments(count=40):
    start, case = cases(count, 5)
    rng = np.random.default_rng(6)
    # Not far apart, so that agents are too near to each other.
    z, drift = 0.5 * start + 0.3 * rng.normal(size=start.shape), 3 * rng.normal(size=start.shape)

    @jax.jit
    @jax.vmap
    def at(z0, z, drift, condition):
        guide, tau = guidance(), jnp.asarray(TIME)
        state = guide.init(z0, condition)
        rows, still = (guide.rows(state, tau, z, f, condition) for f in (drift, 0 * drift))
        _, correction, report = guide(state, tau, z, drift, condition)
        return rows.ell, rows.b, still.b, correction, report.qp_infeasible

    with jax.enable_x64(True):
        inputs = jax.tree.map(jnp.asarray, (start, z, drift, case))
        ell, b, zeta, correction, infeasible = jax.tree.map(np.asarray, at(*inputs))
    u = np.linalg.solve(CONTROL[None], correction[..., None])[..., 0]

    def each(k, s):
        one = jax.tree.map(lambda leaf: leaf[k], case)
        tau, there = np.full(1, TIME + s), z[k] + s * (drift + correction)[k]
        first = values_by_hand(np.zeros(1), start[k][None], one)[0]
        return values_by_hand(tau, there[None], one)[0], limits_by_hand(tau, first)[0]

    def allowed(k):
        (value, bound), slope = each(k, 0.0), (each(k, 1e-6)[1] - each(k, -1e-6)[1]) / 2e-6
        rest = (1 - TIME) * (0.1 + 0.9 * (1 + TIME))
        private = -KAPPA / (1 - RHO) * (0.1 + 1.8 * TIME) / rest * value[2]
        return np.append((slope - GAIN * (value - bound))[:2], private)

    rate = np.array([(each(k, 1e-6)[0] - each(k, -1e-6)[0]) / 2e-6 for k in range(count)])
    decay = np.array([allowed(k) for k in range(count)])
    return Moment(ell, b, zeta, u, infeasible, rate, decay)


def smallest(ell, b, metric):
    """argmin u @ metric @ u subject to ell @ u + b <= 0, by quadprog; None where there is none."""
    length = np.linalg.norm(ell, axis=-1)
    if (b[length == 0] > 1e-12).any():
        return None
    unit, distance = ell[length > 0] / length[length > 0, None], b[length > 0] / length[length > 0]
    try:
        return quadprog.solve_qp(metric, np.zeros(len(metric)), -unit.T.copy(), distance)[0]
    except ValueError:
        return None


def test_each_agents_input_is_the_smallest_in_its_own_metric():
    """Against quadprog, with H_i; with the metric of the next agent it would be another input."""
    one, others = moments(), 0
    for k, i in np.ndindex(one.u.shape[:2]):
        expected = smallest(one.ell[k, :, i], one.b[k, :, i], METRIC[i])
        assert (expected is None) == one.infeasible[k, i]
        if expected is None:
            continue
        scale = 1 + np.linalg.norm(expected)
        np.testing.assert_allclose(one.u[k, i], expected, atol=1e-8 * scale)
        other = smallest(one.ell[k, :, i], one.b[k, :, i], METRIC[i - 1])
        others += np.linalg.norm(one.u[k, i] - other) > 1e-2 * scale
    assert one.infeasible.any(axis=1).mean() <= 0.2
    assert others > 0.3 * one.infeasible.size
    assert np.mean((np.linalg.norm(one.ell, axis=-1) > 0).sum(1) == 3) > 0.3  # three rows at once


def test_rows_of_both_kinds_imply_their_decay_at_once():
    """dq/dtau <= dbeta/dtau - alpha(q - beta), and dV/dtau <= -c omega V^rho, along one and the same input."""
    one = moments()
    good = ~one.infeasible.any(1) & (np.linalg.norm(one.u, axis=-1).max(1) < 1e3)
    assert good.mean() > 0.7
    assert np.all((one.rate - one.decay)[good] <= 1e-4 * (1 + np.abs(one.rate[good])))
    # Each of them decides in some moments: there it holds with equality or nearly.
    assert np.all(np.isclose(one.rate, one.decay, rtol=1e-2, atol=1e-2)[good].mean(0) > 0.05)


def test_all_requirements_share_by_directions_made_over_all_rows():
    """zeta_i |d_j|^2 = zeta_j |d_i|^2, where |d| is a distance that nonnegative least squares finds."""
    one = moments()
    reach = np.zeros(one.b.shape)
    for k, a, i in np.ndindex(one.b.shape):
        others = np.delete(one.ell[k, :, i], a, axis=0)
        reach[k, a, i] = nnls(others.T, -one.ell[k, a, i])[1] ** 2
    crossed = one.zeta[..., None] * reach[..., None, :]
    scale = np.abs(one.zeta).sum(-1) * reach.sum(-1)
    assert np.all(np.abs(crossed - crossed.swapaxes(-1, -2)) <= 1e-7 * scale[..., None, None])
    # Rows by themselves would have had other shares, of shared and of private requirements.
    alone = np.sum(one.ell**2, axis=-1)
    assert np.all(np.mean(np.abs(reach - alone).max(-1) > 0.05 * alone.max(-1), axis=0) > 0.2)


STEPS, SAMPLES = 300, 32


class Run(NamedTuple):
    """Along trajectories, guided and nominal: values by hand, their limits, and what the summary says."""

    value: np.ndarray  # (samples, points, rows)
    limit: np.ndarray
    nominal: np.ndarray  # (samples, rows), at tau = 1
    summary: object
    hypotheses_hold: np.ndarray


@cache
def run():
    start, case = cases(SAMPLES, 3)

    @jax.jit
    @jax.vmap
    def both(z0, condition):
        grid = refined_grid(STEPS)
        out = generate(field, guidance(), z0, condition, grid=grid, guard=None, keep_path=True)
        summary = out.summary
        nominal = generate(field, NoGuidance(), z0, condition, grid=grid).z
        return out.path, nominal, summary, summary.hypotheses_hold

    with jax.enable_x64(True):
        inputs = jax.tree.map(jnp.asarray, (start, case))
        path, nominal, summary, hold = jax.tree.map(np.asarray, both(*inputs))
    tau = 1 - (1 - np.linspace(0, 1, STEPS + 1)) ** 2
    each = [jax.tree.map(lambda leaf, k=k: leaf[k], case) for k in range(SAMPLES)]
    value = np.array([values_by_hand(tau, z, c) for z, c in zip(path, each, strict=True)])
    limit = np.array([limits_by_hand(tau, one[0]) for one in value])
    end = [values_by_hand(tau[-1:], z[None], c)[0] for z, c in zip(nominal, each, strict=True)]
    return Run(value, limit, np.array(end), summary, hold)


@pytest.mark.parametrize("kind", range(2), ids=FIELDS)
def test_both_theorems_hold_at_once_along_the_trajectory(kind):
    """Where the summary says so: q <= beta and V <= its limit at every point, under one input of each agent."""
    one, mine = run(), np.arange(SAMPLES) % 2 == kind
    chosen = one.hypotheses_hold & mine
    assert chosen.sum() >= 0.7 * mine.sum()
    assert np.all((one.value <= one.limit + 1e-9 * (1 + np.abs(one.limit)))[chosen])
    # So shared requirements and every margin hold at the end; without guidance hardly ever.
    assert np.all(one.value[chosen, -1] <= [1e-9, 1e-9, BUFFER**2 / 2 * (1 + 1e-9)])
    broken = one.nominal[mine] > [0.0, 0.0, BUFFER**2 / 2]
    assert np.all(broken.mean(0) > 0.6)
    # All three had to be brought about.
    assert np.all(np.any(one.summary.active_points[chosen] > 0, axis=0))


def test_what_the_summary_says_of_the_values_is_so():
    """`hypotheses_hold` is not said where a value was above its limit, and the excess is the greatest of all points."""
    one = run()
    excess = (one.value - one.limit).max(1)
    above = (excess > 1e-9).any(1)
    assert above.any()  # fixed steps: some samples are
    assert not one.hypotheses_hold[above].any()
    np.testing.assert_allclose(one.summary.excess, excess, atol=1e-9)
