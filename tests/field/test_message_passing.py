import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.field import MessagePassingField, TeamFeatures, stack_features, time_features


def featurise(z, condition):
    offset = z[:, None] - z[None, :]
    return TeamFeatures(jnp.sin(z), jnp.concatenate([offset, offset**2], -1), condition)


@pytest.fixture(scope="module")
def field():
    return MessagePassingField(
        featurise,
        node_size=2,
        pair_size=4,
        spread=(0.5, 1.5),
        width=16,
        rounds=2,
        head_width=16,
        key=jax.random.key(1),
    )


def test_permuting_agents_permutes_the_field(field, key):
    z, mask = jax.random.normal(key, (5, 2)), jnp.array([True, True, True, True, False])
    order = jnp.array([3, 0, 4, 1, 2])
    there = field(jnp.asarray(0.3), z, mask)[order]
    np.testing.assert_allclose(field(jnp.asarray(0.3), z[order], mask[order]), there, atol=1e-5)


@pytest.mark.parametrize("padding", [1, 3])
def test_padding_changes_nothing(field, key, padding):
    z = jax.random.normal(key, (4, 2))
    alone = field(jnp.asarray(0.7), z, jnp.ones(4, bool))
    padded = jnp.concatenate([z, 100 * jnp.ones((padding, 2))])
    mask = jnp.arange(4 + padding) < 4
    np.testing.assert_allclose(field(jnp.asarray(0.7), padded, mask)[:4], alone, atol=1e-5)


def test_every_parameter_takes_part(field, key):
    z, mask = jax.random.normal(key, (4, 2)), jnp.ones(4, bool)

    def loss(field):
        return jnp.sum(field(jnp.asarray(0.5), z, mask) ** 2)

    gradients = jax.tree.leaves(eqx.filter_grad(loss)(field))
    assert all(bool(jnp.any(g != 0)) and bool(jnp.all(jnp.isfinite(g))) for g in gradients)


def test_bfloat16_rounds_products_and_nothing_else(field, key):
    z, mask = jax.random.normal(key, (5, 2)), jnp.ones(5, bool)
    rounded = field.in_bfloat16()
    exact, close = field(jnp.asarray(0.4), z, mask), rounded(jnp.asarray(0.4), z, mask)
    assert 0 < float(jnp.max(jnp.abs(exact - close))) < 0.02 * float(jnp.max(jnp.abs(exact)))
    assert close.dtype == exact.dtype
    for kept, made in zip(jax.tree.leaves(field), jax.tree.leaves(rounded), strict=True):
        assert kept is made


@pytest.mark.parametrize("tau", [0.0, 0.35, 1.0])
def test_with_a_silent_network_the_field_is_that_of_gaussian_data(field, key, tau):
    """E[x1 - x0 | x(tau)] for x0 ~ N(0, 1), x1 ~ N(0, s^2), by regression on samples."""
    last = field.head.layers[-1]
    silent = eqx.tree_at(
        lambda f: (f.head.layers[-1].weight, f.head.layers[-1].bias),
        field,
        (jnp.zeros_like(last.weight), jnp.zeros_like(last.bias)),
    )
    spread = np.array([0.5, 1.5])
    x0 = np.asarray(jax.random.normal(key, (200_000, 2)))
    x1 = spread * np.asarray(jax.random.normal(jax.random.key(9), (200_000, 2)))
    x = (1 - tau) * x0 + tau * x1
    slope = np.mean(x * (x1 - x0), axis=0) / np.mean(x**2, axis=0)
    got = silent(jnp.asarray(tau), jnp.ones((1, 2)), jnp.ones(1, bool))[0]
    np.testing.assert_allclose(got, slope, atol=0.02)


def test_time_features_at_the_ends():
    np.testing.assert_allclose(time_features(jnp.asarray(0.0)), [0, 0, 1, 0, 1], atol=1e-6)
    np.testing.assert_allclose(time_features(jnp.asarray(1.0)), [1, 0, -1, 0, 1], atol=1e-6)


def test_stacked_features_are_a_stack(key):
    """Of samples at once too, and with its gradient."""
    drawn = jax.random.normal(key, (3, 7, 4, 5))  # features, samples, receivers, senders

    def weighed(stack, parts):
        return jnp.sum(stack(list(parts)) ** 2 @ jnp.arange(3.0))

    def usual(parts):
        return jnp.stack(parts, axis=-1)

    one = jax.vmap(lambda parts: stack_features(list(parts)), in_axes=1)(drawn)
    np.testing.assert_array_equal(one, np.moveaxis(np.asarray(drawn), 0, -1))
    np.testing.assert_allclose(
        jax.grad(lambda x: weighed(stack_features, x))(drawn),
        jax.grad(lambda x: weighed(usual, x))(drawn),
        rtol=1e-6,
    )
