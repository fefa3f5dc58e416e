import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from deggflow.guidance import Fixed, Local, Own, Pairs, Pooled

AGENTS = 5
TINY = float(np.finfo(np.float32).tiny)
amounts = st.lists(st.floats(0, 10, width=32), min_size=AGENTS, max_size=AGENTS)
links = st.lists(st.booleans(), min_size=AGENTS**2, max_size=AGENTS**2)


def dependences(linked):
    """Who depends on whom, as a matrix and as a list."""
    matrix = jnp.array(linked).reshape(AGENTS, AGENTS) | jnp.eye(AGENTS, dtype=bool)
    owner, agent = (jnp.asarray(k) for k in np.indices((AGENTS, AGENTS)).reshape(2, -1))
    return matrix, Pairs(owner, agent, matrix.ravel())


def everyones_shares(demand, influence, linked):
    matrix, pairs = dependences(linked)
    yield Own()(demand, influence, lambda: matrix)
    yield Pooled()(demand, influence, lambda: matrix)
    yield Fixed(influence)(demand, jnp.zeros(AGENTS), lambda: matrix)
    yield Local()(demand, influence, lambda: matrix)
    yield Local()(demand, influence, lambda: pairs)


@settings(max_examples=60, deadline=None)
@given(amounts, amounts, links)
@example([0.0] * 4 + [4.0], [0.0] * 4 + [TINY], [False] * AGENTS**2)
@example([0.0] * 4 + [4.0], [1.0] * 4 + [TINY], [False] * AGENTS**2)
def test_shares_are_nonnegative_and_add_up_to_the_demand(demand, influence, linked):
    demand, influence = jnp.array(demand), jnp.array(influence)
    for share in everyones_shares(demand, influence, linked):
        assert jnp.all(share >= 0)
        assert jnp.sum(share) == pytest.approx(float(jnp.sum(demand)), rel=1e-4, abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(amounts, amounts, links)
def test_an_agent_without_influence_owes_nothing_while_somebody_can_act(demand, influence, linked):
    influence = jnp.array(influence).at[0].set(0.0).at[1].set(1.0)
    share = Pooled()(jnp.array(demand), influence, lambda: dependences(linked)[0])
    assert share[0] == 0


@settings(max_examples=60, deadline=None)
@given(amounts, amounts, links)
def test_a_list_of_pairs_shares_as_the_matrix_does(demand, influence, linked):
    *_, matrix, pairs = everyones_shares(jnp.array(demand), jnp.array(influence), linked)
    np.testing.assert_allclose(pairs, matrix, rtol=1e-5, atol=1e-6)


def test_local_demand_stays_among_those_it_depends_on():
    linked = jnp.eye(AGENTS, dtype=bool).at[0, 1].set(True)
    share = Local()(jnp.array([4.0, 0, 0, 0, 0]), jnp.array([1.0, 3, 5, 5, 5]), lambda: linked)
    np.testing.assert_allclose(share, [1.0, 3.0, 0, 0, 0], atol=1e-6)


def test_demand_nobody_can_meet_is_not_dropped():
    demand, nobody = jnp.arange(1.0, 6.0), jnp.zeros(AGENTS)
    for share in everyones_shares(demand, nobody, [False] * AGENTS**2):
        assert jnp.array_equal(share, demand)


def test_a_demand_that_all_may_divide_is_pooled():
    """A factor's: whoever owns it, local shares are those of the whole team."""
    demand, influence = jnp.arange(1.0, 6.0), jnp.array([1.0, 0, 2, 5, 0.5])
    together = jnp.ones((AGENTS, AGENTS), bool)
    local, pooled = (each(demand, influence, lambda: together) for each in (Local(), Pooled()))
    np.testing.assert_allclose(local, pooled, rtol=1e-6)


def test_fixed_shares_need_one_weight_per_agent():
    share = Fixed(jnp.ones(AGENTS - 1))
    with pytest.raises(ValueError, match=r"`weight` must have shape \(5,\), one number per agent"):
        share(jnp.ones(AGENTS), jnp.ones(AGENTS), lambda: jnp.ones((AGENTS, AGENTS), bool))
