"""Equations: a ring by guidance and, up to rounding, by a last step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import requirements as req
from deggflow import sample, verdicts


def ring(z, condition):
    return jnp.sum(z**2, axis=1, keepdims=True) - 1.0


def field(tau, z, condition):
    """From N(0, I) to N((1, 0), 0.3^2 I), whose samples are seldom on the ring."""
    mean, variance = jnp.array([[1.0, 0.0]], z.dtype), 0.3**2
    gain = tau * variance / (tau**2 * variance + (1 - tau) ** 2)
    return (mean + gain * (z - tau * mean) - z) / jnp.maximum(1 - tau, 1e-3)


ON_RING = req.equal(ring, 1e-3, name="ring")


def test_guidance_meets_the_tolerance_and_the_last_step_meets_it_to_rounding():
    result = sample(field, (ON_RING,), key=jax.random.key(0), count=64, shape=(3, 2))
    assert result.satisfied.all()
    assert all(each.draws == 1 for each in result.certificates)
    residual = np.abs(np.sum(np.asarray(result.z, float) ** 2, axis=-1) - 1).max()
    assert 1e-7 < residual <= 1e-3
    solved = req.solve(result.z, ring)
    assert solved.z.dtype == np.float64
    assert np.abs(np.sum(solved.z**2, axis=-1) - 1).max() <= 4.5e-16
    assert (solved.residual <= 4.5e-16).all()
    assert (solved.moved <= 1e-3).all()
    [verdict] = verdicts(solved.z[0], (req.equal(ring, 1e-15, name="ring"),))
    assert verdict.reason is None


def test_the_last_step_is_the_shortest_way():
    """Onto a line, the projection."""
    z = np.random.default_rng(0).normal(size=(5, 2, 2))
    solved = req.solve(z, lambda z, condition: (z @ condition)[:, None] - 1.0, np.array([3.0, 4.0]))
    normal = np.array([0.6, 0.8])
    expected = z + (0.2 - z @ normal)[..., None] * normal
    assert np.allclose(solved.z, expected, atol=1e-14)
    assert np.allclose(solved.moved, np.abs(z @ normal - 0.2).max(axis=1))


def test_equations_that_cannot_hold_keep_the_closest_states():
    solved = req.solve(np.ones((1, 1, 2)), lambda z, _: jnp.sum(z**2, axis=1, keepdims=True) + 1.0)
    assert solved.residual[0] >= 1.0
    assert np.isfinite(solved.z).all()


def test_a_tolerance_must_be_positive():
    with pytest.raises(ValueError, match="`tolerance` must be positive"):
        req.equal(ring, 0.0)
