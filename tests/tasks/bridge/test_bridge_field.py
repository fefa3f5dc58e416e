"""The bridge's network against a second implementation, robot by robot, from the same weights."""

from collections import defaultdict
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.jsonl import InputError
from deggflow.tasks.bridge.condition import BridgeCondition, Scales, observe, to_arrays
from deggflow.tasks.bridge.field import SHIPPED, load_field
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.weights import save_weights

AGENTS, DIM, T = 6, 24, 20
evaluate = jax.jit(lambda field, tau, z, condition: field(tau, z, condition))
seen_by = jax.jit(observe, static_argnums=1)


@pytest.fixture(scope="module")
def field():
    """The shipped one: trained weights tell more apart than fresh ones."""
    assert SHIPPED.is_file()
    return load_field()


def random_state(robots, agents=AGENTS, seed=0):
    """A random trial in motion, with a continuation."""
    rng = np.random.default_rng([seed, robots])
    arrays = to_arrays(random_conditions(robots, 1, seed), agents)
    state = jax.tree.map(lambda leaf: leaf[0], arrays)
    ahead = 0.3 * rng.normal(size=(T, 3))
    return state._replace(
        twist=jnp.asarray(ahead[0], jnp.float32), continuation=jnp.asarray(ahead, jnp.float32)
    )


def noise(seed=3, agents=AGENTS):
    return jnp.asarray(np.random.default_rng(seed).normal(size=(agents, DIM)), jnp.float32)


def silu(x):
    return x / (1 + np.exp(-x))


def dense(layer, x):
    return np.asarray(layer.weight, np.float64) @ x + np.asarray(layer.bias, np.float64)


def by_hand(field, tau, z, condition):
    """psi_ag([z_i, c_i, lambda_i, mean m_ij, (N - 1) / 7, phi(tau)]), m_ij = psi_msg([z_j, c_j, pi_ij])."""
    seen = jax.tree.map(lambda x: np.asarray(x, np.float64), seen_by(condition, field.scales))
    z, robots = np.asarray(z, np.float64), int(np.sum(condition.mask))
    time = [
        tau,
        np.sin(np.pi * tau),
        np.cos(np.pi * tau),
        np.sin(2 * np.pi * tau),
        np.cos(2 * np.pi * tau),
    ]
    out = []
    for i in range(robots):
        messages = []
        for j in range(robots):
            if j != i:
                heard = np.concatenate([z[j], seen.contact[j], seen.other[i, j]])
                assert heard.shape == (77,)
                messages.append(dense(field.message_out, silu(dense(field.message, heard))))
        mean = np.mean(messages, axis=0)
        read = np.concatenate([z[i], seen.contact[i], seen.own[i], mean, [(robots - 1) / 7], time])
        assert read.shape == (258,)
        hidden = silu(dense(field.entry, read))
        for layer in field.inner:
            hidden = silu(dense(layer, hidden))
        out.append(dense(field.exit, hidden))
    return np.array(out)


@pytest.mark.parametrize("robots", [2, 4, 6])
@pytest.mark.parametrize("tau", [0.0, 0.37, 1.0])
def test_field_is_the_papers_network(field, robots, tau):
    condition, z = random_state(robots), noise()
    found = np.asarray(evaluate(field, jnp.asarray(tau), z, condition))
    np.testing.assert_allclose(
        found[:robots], by_hand(field, tau, z, condition), atol=1e-3, rtol=1e-3
    )


def test_layer_sizes_are_the_papers(field):
    """77-160-160 and 258-256-256-256-24, with biases: 242,296 numbers."""
    of_message = [layer.weight.shape for layer in (field.message, field.message_out)]
    assert of_message == [(160, 77), (160, 160)]
    of_agent = [layer.weight.shape for layer in (field.entry, *field.inner, field.exit)]
    assert of_agent == [(256, 258), (256, 256), (256, 256), (24, 256)]
    count = sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(field, eqx.is_array)))
    sizes = defaultdict(int)
    for chain in ((77, 160, 160), (258, 256, 256, 256, 24)):
        for a, b in pairwise(chain):
            sizes[chain] += a * b + b
    assert count == sum(sizes.values()) == 242_296


def test_a_permutation_of_the_robots_permutes_the_output(field):
    condition, z = random_state(6), noise()
    order = np.array([2, 0, 5, 1, 4, 3])
    moved = condition._replace(contacts=condition.contacts[order], mask=condition.mask[order])
    here, there = (
        np.asarray(evaluate(field, jnp.asarray(0.6), x, c))
        for x, c in ((z, condition), (z[order], moved))
    )
    np.testing.assert_allclose(there, here[order], atol=2e-5)
    assert np.abs(here - here[order]).max() > 1e-3


def test_absent_robots_change_nothing(field):
    """Whatever stands in their places, and however many there are."""
    small, large = random_state(4), random_state(4, agents=8)
    z = noise(agents=8)
    tau = jnp.asarray(0.3)
    alone = np.asarray(evaluate(field, tau, z[:AGENTS], small))
    wild = large._replace(contacts=large.contacts.at[4:].set(7.0))
    padded = np.asarray(evaluate(field, tau, z.at[4:].set(50.0), wild))
    np.testing.assert_allclose(padded[:4], alone[:4], atol=2e-5)


def test_under_a_condition_it_is_the_same_field(field):
    condition, z = random_state(5), noise()
    fixed = jax.jit(lambda f, c, tau, z: f.under(c)(tau, z, None))
    for tau in (0.0, 0.5, 0.99):
        tau = jnp.asarray(tau)
        np.testing.assert_array_equal(
            fixed(field, condition, tau, z), evaluate(field, tau, z, condition)
        )


def test_it_reads_every_part_of_its_condition(field):
    """Nothing that the condition says is lost on the way to the network."""
    condition, z, tau = random_state(5), noise(), jnp.asarray(0.4)
    here = np.asarray(evaluate(field, tau, z, condition))[:5]
    for name in BridgeCondition._fields:
        if name != "mask":
            leaf = getattr(condition, name)
            other = evaluate(field, tau, z, condition._replace(**{name: leaf + 0.05}))
            assert np.abs(np.asarray(other)[:5] - here).max() > 1e-4, name


def test_saved_weights_are_read_back(field, tmp_path):
    path = tmp_path / "field.safetensors"
    save_weights(path, field, {"scales": field.scales._asdict()})
    again = load_field(path)
    assert again.scales == field.scales
    for a, b in zip(jax.tree.leaves(field), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)


def _with(name, value):
    scales = {**Scales()._asdict(), name: value}
    return {"scales": scales}


@pytest.mark.parametrize(
    ("card", "reason"),
    [
        ({}, "`scales`: must be a JSON object; got null"),
        ({"scales": [1, 2]}, "`scales`: must be a JSON object"),
        ({"scales": {"eta": [1.0] * 24}}, "`scales.continuation_mean`: is missing"),
        (_with("other", [1.0]), "`scales.other`: unknown key"),
        (_with("eta", None), "`scales.eta`: must be a list; got null"),
        (_with("eta", [1.0]), "`scales.eta`: must hold 24 numbers; got 1"),
        (_with("contact", [1.0, "1"]), r"`scales.contact\[1\]`: must be a number"),
        (_with("contact", [1.0, 0.0]), r"`scales.contact\[1\]`: must lie in \[1e-06, 1e"),
        (_with("twist", [1.0, -1.0, 1.0]), r"`scales.twist\[1\]`: must lie in"),
        (_with("twist", [1.0, 1.0, 1e300]), r"`scales.twist\[2\]`: must lie in"),
    ],
)
def test_a_card_without_its_scales_is_refused(field, tmp_path, card, reason):
    path = tmp_path / "field.safetensors"
    save_weights(path, field, card)
    with pytest.raises(InputError, match=rf"field\.json, field {reason}"):
        load_field(path)
