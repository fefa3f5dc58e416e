import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import certify


def margins(z, condition):
    return jnp.stack([condition - z[:, 0], z[:, 1]], axis=1)


def test_margins_decide_and_are_evaluated_in_float64():
    z = np.array([[0.0, 1.0], [0.1 - 1e-12, 0.3]])
    bound = np.float64(0.1)
    certificate = certify(margins, z, bound)
    assert certificate.satisfied
    assert certificate.reason is None
    assert 0 < certificate.min_margin < 2e-12  # float32 could not tell
    assert not certify(margins, z + 1e-9, bound).satisfied


def test_the_worst_agent_and_requirement_are_named():
    z = jnp.array([[0.0, 1.0], [0.5, -0.25]])
    certificate = certify(margins, z, 0.4, names=("reach", "height"), buffer=0.1, draws=3)
    assert not certificate.satisfied
    assert certificate.min_margin == -0.25
    assert certificate.reason == "agent 1 misses height by 0.25"
    assert certificate.draws == 3
    short = 0.5 - 0.4 + 0.1
    assert certificate.violation == pytest.approx((short**2 + 0.35**2) / 2, rel=1e-6)
    assert set(certificate.to_json()) == {"satisfied", "min_margin", "violation", "draws", "reason"}


def test_a_sample_that_is_not_a_number_is_never_satisfied():
    certificate = certify(margins, jnp.full((2, 2), jnp.nan), 0.4)
    assert not certificate.satisfied


def test_float64_does_not_leak_out():
    certify(margins, jnp.zeros((2, 2)), 0.4)
    assert jax.numpy.zeros(1).dtype == jnp.float32
