"""Three agents that are drawn to one point, and what is required of them."""

import jax
import jax.numpy as jnp

from deggflow import (
    DecoupledGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    distances,
    generate,
)

BUFFER = 0.02


def gather(tau, z, condition):
    """Everybody to one point."""
    return (jnp.array([[0.4, 0.1]], z.dtype) - z) * 2.0


def far(z, condition):
    return distances(z) - 0.3


def mean_x(tau, z, condition):
    return jnp.mean(z[:, 0])


def still(tau, z, condition):
    return jnp.zeros_like(z)


APART = PrivateRequirement(far, BUFFER, name="apart")
LEFT = SharedRequirements((SharedFactor(mean_x, name="left"),))
Z0 = jnp.array([[-1.0, 0.2], [0.5, 1.0], [0.8, -0.6]])


def guided(requirements, z0=Z0, field=gather, **options):
    return jax.jit(
        lambda z0: generate(field, DecoupledGuidance(requirements), z0, None, **options)
    )(z0)
