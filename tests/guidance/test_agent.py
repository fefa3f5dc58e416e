"""One agent's input, computed alone, is its part of the team's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    Local,
    Pooled,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
)
from deggflow.guidance.agent import agent_input, communication_cost

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
SHARED = SharedRequirements(
    (SharedFactor(spread, name="spread"), SharedFactor(lean, incidence=first_two, name="lean"))
)
PRIVATE = PrivateRequirement(margins, 0.05, Pooled())


@pytest.mark.parametrize("g", [None, control], ids=["identity", "control map"])
def test_an_agent_alone_finds_its_part_of_the_teams_inputs(g, key):
    """Three rows of shared and private requirements; the others' drifts are not even numbers to it.

    With control maps every agent has a metric of its own, too.
    """
    guidance = DecoupledGuidance((SHARED, PRIVATE), control=g, metric=None if g is None else METRIC)
    z, drift = jax.random.normal(key, (2, AGENTS, DIM))
    state, tau = guidance.init(z, None), jnp.asarray(0.4)
    _, together, report = jax.jit(lambda: guidance(state, tau, z, drift, None))()
    alone = jax.jit(jax.vmap(lambda i, own: agent_input(guidance, state, i, tau, z, own, None)))(
        jnp.arange(AGENTS), drift
    )
    assert jnp.any(report.input_norm > 0)
    np.testing.assert_allclose(alone.correction, together, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(alone.feasible, ~report.qp_infeasible)


def test_an_agent_is_told_the_others_states_and_no_more():
    heard = communication_cost(jnp.zeros((8, 24), jnp.float32))
    assert heard.per_step == 7 * 24 * 4


CHAIN = 8


def chained(z, condition):
    """Each agent keeps close to the next one: a chain, in which V_j depends on two agents."""
    return 0.5 - jnp.abs(z[1:] - z[:-1]).sum(-1, keepdims=True)


def along(z, condition):
    return jnp.concatenate([chained(z, condition), jnp.full((1, 1), 1.0, z.dtype)])


@pytest.mark.parametrize(
    ("allocation", "per_owner_gain", "local"),
    [(Local(), True, True), (Local(), False, False), (Pooled(), True, False)],
)
def test_local_shares_with_own_gains_need_three_links_and_others_need_all(
    allocation, per_owner_gain, local
):
    """The input of the first agent of a chain, as those farther along are moved by themselves."""
    one = PrivateRequirement(along, 0.05, allocation, per_owner_gain=per_owner_gain)
    guidance = DecoupledGuidance((one,))
    z = jnp.arange(CHAIN, dtype=jnp.float32)[:, None] * jnp.array([[1.0, 0.3]])

    @jax.jit
    def first(z):
        state, still = guidance.init(z, None), jnp.zeros(2)
        return agent_input(guidance, state, jnp.asarray(0), jnp.asarray(0.4), z, still, None).u

    moved = [bool(np.any(first(z.at[k].add(0.05)) != first(z))) for k in range(CHAIN)]
    assert moved[:3] == [True] * 3
    assert moved[4:] == [not local] * (CHAIN - 4)
