"""How long inputs can become at most: with g = I, H = I, pooled allocation of shared and private requirements, every agent has

|u_i| <= |f_i| + sum_a max(owed_a, 0) |d_{a,i}| / sum_j |d_{a,j}|^2,

as `u = -f_i - sum_a max(w_{a,i} owed_a, 0) d_{a,i} / |d_{a,i}|^2` meets its rows. Opposed rows do not make inputs
large while somebody else can act. With two rows and phi_delta it holds up to a factor 1 + 9 delta^2 / 256 or so:
inside the blend `ell . d` is that much less than `|d|^2`.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import nnls

from deggflow import DecoupledGuidance, PrivateRequirement, SharedFactor, SharedRequirements
from deggflow.guidance import AbstractBound, AbstractMargins, Own, Pooled

AGENTS, DIM, DELTA, TIME = 4, 3, 0.02, 0.5
RHO, KAPPA = 0.75, 1.15
HEIGHT = 20.0  # of every violation, about
# phi (phi - eta) / (1 - phi eta), by which |d|^2 is more than l . d, is at most this.
BLEND = 9 * DELTA**2 / 256 / (1 - DELTA**2)


def nowhere(condition):
    return jnp.inf


class Level(AbstractBound):
    """beta = q(z(0)); what it is at the end does not matter here."""

    end: Callable = nowhere

    def init(self, value, condition):
        return value

    def __call__(self, state, tau):
        return state + 0.0 * tau


class Case(NamedTuple):
    """Gradients of linear requirements, what is owed, and who drifts where."""

    shared: np.ndarray  # (cases, factors, agents, dim): grad q
    private: np.ndarray  # (cases, owners, agents, dim): grad V_j
    rise: np.ndarray  # (cases, factors): dq/dtau, the factor's demand
    height: np.ndarray  # (cases, owners): V_j
    drift: np.ndarray  # (cases, agents, dim)


class Linear(AbstractMargins):
    """Violations that are linear in the states, as no hinge is."""

    def __call__(self, z, condition):
        return -self.violation(z, condition, 0.0)[:, None]

    def violation(self, z, condition, buffer):
        return condition.height + jnp.einsum("jad,ad->j", condition.private, z)

    def violation_and_gradient(self, z, condition, buffer):
        return self.violation(z, condition, buffer), jnp.sum(condition.private, axis=0)

    def dependence(self, z, condition, buffer):
        return jnp.ones((AGENTS, AGENTS), bool)


def guidance(factors, allocation):
    shared = SharedRequirements(
        tuple(
            SharedFactor(
                lambda tau, z, c, k=k: jnp.sum(c.shared[k] * z) + c.rise[k] * tau,
                Level(),
                allocation=allocation,
                name=f"shared {k}",
            )
            for k in range(factors)
        )
    )

    private = PrivateRequirement(Linear(), 0.0, rho=RHO, kappa=KAPPA)
    return DecoupledGuidance((shared, private))


def cases(factors, count, seed):
    """Random rows; in half of the cases agent 0 (in some of them agent 1 too) has two that are nearly opposed."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(count, factors, AGENTS, DIM))
    shared *= 10.0 ** rng.uniform(-1, 1, (count, factors, AGENTS, 1))
    private = rng.normal(size=(count, AGENTS, AGENTS, DIM))
    for k in range(count // 2):
        for agent in range(1 + (k % 4 == 0)):
            ell = shared[k, 0, agent]
            aside = np.cross(ell, rng.normal(size=DIM))
            aside *= np.linalg.norm(ell) / np.linalg.norm(aside)
            angle = 10.0 ** rng.uniform(-5, -3)
            back = -(np.cos(angle) * ell + np.sin(angle) * aside) * 10.0 ** rng.uniform(-1, 1)
            if factors > 1:
                shared[k, 1, agent] = back
            else:
                private[k, 0, agent] += back - private[k, :, agent].sum(0)
    rise, height = 5 * rng.normal(size=(count, factors)), HEIGHT * rng.uniform(size=(count, AGENTS))
    return Case(shared, private, rise, height, 3 * rng.normal(size=(count, AGENTS, DIM)))


def owed_by_hand(case):
    """dq/dtau - dbeta/dtau + alpha(q - beta) at z = z(0); and c omega sum_j V_j^rho."""
    rest = (1 - TIME) * (0.1 + 0.9 * (1 + TIME))
    c = KAPPA / (1 - RHO) * case.height.sum(-1) ** (1 - RHO) / rest
    private = c * (0.1 + 1.8 * TIME) * (case.height**RHO).sum(-1)
    return np.concatenate([case.rise * (1 + TIME), private[:, None]], axis=-1)


def papers_phi(eta):
    if abs(eta) >= DELTA:
        return min(eta, 0.0)
    return DELTA * (eta / DELTA - 1) ** 3 * (eta / DELTA + 3) / 16


def reach_by_hand(case):
    """|d_{a,i}|: the paper's of two rows; of more, the distance to what the other rows oppose."""
    ell = np.concatenate([case.shared, case.private.sum(1)[:, None]], axis=1)
    reach = np.zeros(ell.shape[:-1])
    for k, a, i in np.ndindex(reach.shape):
        row, others = ell[k, a, i], np.delete(ell[k, :, i], a, axis=0)
        if len(others) == 1:
            unit = others[0] / np.linalg.norm(others[0])
            eta = row @ unit / np.linalg.norm(row)
            reach[k, a, i] = np.linalg.norm(row - np.linalg.norm(row) * papers_phi(eta) * unit)
        else:
            reach[k, a, i] = nnls(others.T, -row)[1]
    return ell, reach


def inputs(factors, case, allocation):
    @jax.jit
    @jax.vmap
    def at(case):
        guide, z = guidance(factors, allocation), jnp.zeros((AGENTS, DIM))
        state = guide.init(z, case)
        return guide(state, jnp.asarray(TIME), z, case.drift, case)[1:]

    with jax.enable_x64(True):
        u, report = jax.tree.map(np.asarray, at(jax.tree.map(jnp.asarray, case)))
    return np.linalg.norm(u, axis=-1), report


@cache
def instance(factors, count=80):
    """Cases, how long each agent's input may be, and who has any effective direction at all."""
    case = cases(factors, count, factors)
    (ell, reach), owed = reach_by_hand(case), np.maximum(owed_by_hand(case), 0.0)
    longest = np.linalg.norm(case.drift, axis=-1)
    longest += (owed[..., None] * reach / (reach**2).sum(-1, keepdims=True)).sum(1)
    free = (reach > 1e-9 * np.linalg.norm(ell, axis=-1)).any(1)
    return case, longest, free


@pytest.mark.parametrize("factors", [1, 2, 3])
def test_inputs_are_no_longer_than_the_theorem_says(factors):
    case, longest, free = instance(factors)
    size, report = inputs(factors, case, Pooled())
    # Where all directions vanish, u = -f_i is the only input that meets the rows: rounding says if it is found.
    assert not report.qp_infeasible[free].any()
    assert free.mean() > 0.7
    blend = BLEND if factors == 1 else 0.0
    assert np.all(size <= longest * (1 + blend + 1e-7))
    assert np.quantile(size / longest, 0.9) > 0.9  # no loose bound


@pytest.mark.parametrize("factors", [1, 2])
def test_opposed_rows_under_equal_shares_have_no_such_bound(factors):
    case, longest, _ = instance(factors)
    size, _ = inputs(factors, case, Own())
    opposed = (size / longest)[: len(size) // 2].max(-1)
    assert np.mean(opposed > 2) > 0.4
    assert opposed.max() > 1e3
