"""Conditional probability paths and the multi-agent flow-matching loss."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from deggflow.shapes import Scalar, States

Field = Callable[[Scalar, States, Any], States]
"""A vector field: (tau, z, condition) -> dz/dtau, one sample."""


class AbstractPath(eqx.Module):
    """A conditional path from noise x0 at tau = 0 to data x1 at tau = 1."""

    @abc.abstractmethod
    def sample(self, tau: Scalar, x0: States, x1: States) -> tuple[States, States]:
        """The point at tau and the conditional velocity there."""


class LinearPath(AbstractPath):
    """Straight-line path x(tau) = (1 - tau) x0 + tau x1."""

    def sample(self, tau: Scalar, x0: States, x1: States) -> tuple[States, States]:
        return (1 - tau) * x0 + tau * x1, x1 - x0


def mac_loss(
    field: Field,
    tau: Scalar,
    x0: States,
    x1: States,
    condition: Any,
    mask: Bool[Array, " agents"],
    path: AbstractPath | None = None,
) -> Scalar:
    """Integrand of the multi-agent conditional flow-matching loss, one sample.

    Args:
        field: Nominal vector field.
        tau: Generative time, drawn from Unif[0, 1].
        x0: Noise, drawn from p_0.
        x1: Encoded data.
        condition: What the field is conditioned on.
        mask: True for the agents that are present; padding does not count.
        path: Conditional path, straight by default.

    Source: paper, eqn:macfm_loss.
    """
    x, velocity = (path or LinearPath()).sample(tau, x0, x1)
    square = jnp.sum((field(tau, x, condition) - velocity) ** 2, axis=-1)
    return jnp.sum(jnp.where(mask, square, 0.0)) / jnp.sum(mask)
