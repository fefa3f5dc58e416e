"""Two shared factors of five agents, fields that fight them, and the same factors once more by hand in numpy."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from deggflow import DecoupledGuidance
from deggflow.guidance import AbstractBound, SharedFactor, SharedRequirements

AGENTS, DIM, INPUTS = 5, 4, 5
NEAR, BELOW = [0, 1, 2], [1, 2, 3]  # agents of the two factors; agent 4 is in none
RATE = 2.5


def far(condition):
    """Above whatever the bound decays to."""
    return 10.0


class Decaying(AbstractBound):
    """A bound of one's own: (q(z(0)) + 0.1) e^(-2.5 tau) if that is positive, else level."""

    end: Callable = far

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


def guidance(allocations=None, mapped=False):
    factors = FACTORS
    if allocations is not None:
        pairs = zip(FACTORS, allocations, strict=True)
        factors = tuple(replace(factor, allocation=each) for factor, each in pairs)
    requirements = SharedRequirements(factors)
    return DecoupledGuidance((requirements,), control if mapped else None)


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def cases(count, seed):
    """Starting points and conditions, in turn of all kinds.

    The half-space is inclined to the first two coordinates: an agent's two rows may work against each other,
    as their cosine is anything in [-0.6, 0.6], but are never opposed. (Where rows come close to that, inputs
    grow without limit, and steps of any size overshoot: the theorem is of inputs that exist.)
    """
    rng = np.random.default_rng(seed)
    one, two, path = (unit(rng.normal(size=(count, 2))) for _ in range(3))
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
