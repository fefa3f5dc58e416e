"""The factor of a metric, and what is mapped by it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.guidance.metric import above, below, factor


@pytest.mark.parametrize("inputs", range(1, 7))
def test_a_metric_is_factored(inputs: int) -> None:
    rng = np.random.default_rng(inputs)
    part, rows = rng.normal(size=(inputs, inputs)), rng.normal(size=(5, inputs))
    metric = part @ part.T + np.eye(inputs)
    with jax.enable_x64(True):
        root = factor(jnp.asarray(metric))
        lower, upper = below(root, jnp.asarray(rows)), above(root, jnp.asarray(rows[0]))
    exact = np.linalg.cholesky(metric)
    np.testing.assert_allclose(root, exact, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(lower, np.linalg.solve(exact, rows.T).T, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(upper, np.linalg.solve(exact.T, rows[0]), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("inputs", [2, 5])
def test_what_is_not_positive_definite_has_no_factor(inputs: int) -> None:
    metric = jnp.eye(inputs).at[0, 1].set(2.0).at[1, 0].set(2.0)
    assert jnp.isnan(factor(metric)).any()
