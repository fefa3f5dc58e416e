"""One agent's input, computed alone, is its part of the team's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    Pooled,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    hinge_violation,
)
from deggflow.guidance.agent import agent_input, told

AGENTS, DIM, INPUTS = 4, 3, 2


def margins(z, condition):
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.5


def spread(tau, z, condition):
    return jnp.sum((z - jnp.mean(z, axis=0)[None]) ** 2) - 1.0


def lean(tau, z, condition):
    return jnp.sum(z[:2, 0]) - 0.5 * tau


def control(tau, z, condition):
    base = jax.random.normal(jax.random.key(1), (AGENTS, DIM, INPUTS))
    return base * (1 + 0.1 * jnp.tanh(z[:, :1, None]))


def first_two(condition):
    return jnp.arange(AGENTS) < 2


ROOT = jax.random.normal(jax.random.key(2), (AGENTS, INPUTS, INPUTS))
METRIC = ROOT @ ROOT.swapaxes(1, 2) + 0.2 * jnp.eye(INPUTS)[None]
SHARED = SharedRequirements((SharedFactor(spread), SharedFactor(lean, incidence=first_two)))
PRIVATE = PrivateRequirement(hinge_violation(margins, 0.05), Pooled())


@pytest.mark.parametrize("g", [None, control], ids=["identity", "control map"])
def test_an_agent_alone_finds_its_part_of_the_teams_inputs(g, key):
    """Three rows of shared and private requirements; the others' drifts are not even numbers to it.

    With control maps every agent has a metric of its own, too.
    """
    guidance = DecoupledGuidance((SHARED, PRIVATE), control=g, metric=None if g is None else METRIC)
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state, tau = guidance.init(z, None), jnp.asarray(0.4)
    together, report = jax.jit(lambda: guidance(state, tau, z, drift, None))()
    alone = jax.jit(jax.vmap(lambda i, own: agent_input(guidance, state, i, tau, z, own, None)))(
        jnp.arange(AGENTS), drift
    )
    assert jnp.any(report.effort > 0)
    np.testing.assert_allclose(alone.correction, together, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(alone.feasible, ~report.infeasible)


def test_an_agent_is_told_the_others_states_and_no_more():
    heard = told(jnp.zeros((8, 24), jnp.float32))
    assert heard.per_step == 7 * 24 * 4
