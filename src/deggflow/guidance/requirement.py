"""What a requirement is: half-spaces `ell @ u + b <= 0` for every agent it touches."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

ControlMap = Callable[
    [Float[Array, ""], Float[Array, "agents dim"], Any], Float[Array, "agents dim inputs"]
]
"""g: (tau, z, condition) -> one matrix per agent; `None` stands for the identity."""


class Rows(NamedTuple):
    """Rows of every agent's local QP, one per factor of a requirement.

    `ell` is g_i^T times the gradient in z_i (requirement units per input unit); `b` is what the agent must
    bring down, positive where it must act.
    """

    ell: Float[Array, "rows agents inputs"]
    b: Float[Array, "rows agents"]
    value: Float[Array, " rows"]  # V or q: how far it is from being met
    bound: Float[Array, " rows"]  # what the theorem promises of the value at this tau
    able: Bool[Array, "rows agents"]  # whether the theorem's condition for a feasible row holds


class AbstractRequirement(eqx.Module):
    """Hard requirements that give each agent one row each, from states alone."""

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """What reports call them, one name per row."""

    @abc.abstractmethod
    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> Any:
        """State for one sample; bounds may depend on z(0)."""

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
        """Every agent's rows at (tau, z), where the nominal field is `drift` and g is `control`."""


def input_gradient(
    control: Float[Array, "agents dim inputs"] | None, gradient: Float[Array, "agents dim"]
) -> Float[Array, "agents inputs"]:
    """g_i^T gradient_i of every agent."""
    return gradient if control is None else jnp.einsum("adm,ad->am", control, gradient)
