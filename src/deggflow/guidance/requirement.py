"""What a requirement is: one half-space `ell @ u + b <= 0` for every agent it touches."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

ControlMap = Callable[
    [Float[Array, ""], Float[Array, "agents dim"], Any], Float[Array, "agents dim inputs"]
]
"""g: (tau, z, condition) -> one matrix per agent; `None` stands for the identity."""


class Rows(NamedTuple):
    """One row of every agent's local QP.

    `ell` is g_i^T times the gradient in z_i (requirement units per input unit); `b` is what the agent must
    bring down, positive where it must act; `value` is the requirement's own measure of how far it is from
    being met, for the trace.
    """

    ell: Float[Array, "agents inputs"]
    b: Float[Array, " agents"]
    value: Float[Array, ""]


class AbstractRequirement(eqx.Module):
    """A hard requirement that gives each agent one row, from states alone."""

    name: eqx.AbstractVar[str]

    @abc.abstractmethod
    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> Any:
        """State of the requirement for one sample; bounds may depend on z(0)."""

    @abc.abstractmethod
    def rows(
        self,
        state: Any,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        control: Float[Array, "agents dim inputs"] | None,
        condition: Any,
    ) -> Rows:
        """Every agent's row at (tau, z), where the nominal field is `drift` and g is `control`."""


def input_gradient(
    control: Float[Array, "agents dim inputs"] | None, gradient: Float[Array, "agents dim"]
) -> Float[Array, "agents inputs"]:
    """g_i^T gradient_i of every agent."""
    return gradient if control is None else jnp.einsum("adm,ad->am", control, gradient)
