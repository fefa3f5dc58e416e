import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.flow import LinearPath, mac_loss


def test_linear_path_joins_noise_and_data_at_its_own_velocity(key):
    x0, x1 = jax.random.normal(key, (2, 4, 3))
    path = LinearPath()
    assert jnp.array_equal(path.sample(jnp.asarray(0.0), x0, x1)[0], x0)
    assert jnp.array_equal(path.sample(jnp.asarray(1.0), x0, x1)[0], x1)
    step = 1e-2
    before, velocity = path.sample(jnp.asarray(0.4), x0, x1)
    after, _ = path.sample(jnp.asarray(0.4 + step), x0, x1)
    np.testing.assert_allclose((after - before) / step, velocity, atol=1e-4)


def test_the_exact_field_of_a_single_datum_has_no_loss(key):
    x0, x1 = jax.random.normal(key, (2, 4, 3))

    def field(tau, z, condition):
        return (x1 - z) / (1 - tau)

    loss = mac_loss(field, jnp.asarray(0.3), x0, x1, None, jnp.ones(4, bool))
    assert loss == pytest.approx(0.0, abs=1e-9)


def test_loss_is_the_mean_over_agents_that_are_present(key):
    x0, x1 = jax.random.normal(key, (2, 4, 3))
    mask = jnp.array([True, True, False, True])

    def at_rest(tau, z, condition):
        return jnp.where(mask[:, None], 0.0, jnp.inf)

    loss = mac_loss(at_rest, jnp.asarray(0.3), x0, x1, None, mask)
    present = np.asarray(mask)
    expected = np.mean(np.sum((np.asarray(x1) - np.asarray(x0))[present] ** 2, axis=1))
    assert loss == pytest.approx(expected, rel=1e-6)
