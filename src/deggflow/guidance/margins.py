"""Margins h_jk of requirements that each agent has for itself, and the violation that guidance brings down.

A plain function of (z, condition) is enough; tasks with thousands of margins give an object that sums them faster.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import AgentValues, Mask, Scalar, States

Margins = Callable[[States, Any], Float[Array, "agents margins"]]
"""h: (z, condition) -> signed margins, one row per agent, `>= 0` where they hold."""


class Pairs(NamedTuple):
    """Which owners' violations depend on which agents, as a list.

    Attributes:
        owner: Index of the agent whose violation it is.
        agent: Index of the agent on whose state it depends.
        active: Whether it depends on that state now.
    """

    owner: Int[Array, " pairs"]
    agent: Int[Array, " pairs"]
    active: Bool[Array, " pairs"]


Dependence = Bool[Array, "owners agents"] | Pairs


class AbstractMargins(eqx.Module):
    """Margins with a violation and a gradient of their own making."""

    @abc.abstractmethod
    def __call__(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """h_jk, or for each agent the least of several of one kind; infinite or large where there is none."""

    @abc.abstractmethod
    def violation(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j >= sum_k max(buffer - h_jk, 0)^2 / 2, and zero where that is zero; zero for absent agents."""

    def violation_and_gradient(
        self, z: States, condition: Any, buffer: float
    ) -> tuple[AgentValues, States]:
        """V_j, and the gradient of their sum."""

        def total(z: States) -> tuple[Scalar, Array]:
            parts = self.violation(z, condition, buffer)
            return jnp.sum(parts), parts

        gradient, parts = jax.grad(total, has_aux=True)(z)
        return parts, gradient

    @abc.abstractmethod
    def dependence(
        self, z: States, condition: Any, buffer: float
    ) -> Bool[Array, "owners agents"] | Pairs:
        """Which agents' states each V_j depends on now; always on its own."""


class MarginLabel(NamedTuple):
    """What a certificate says of one column of margins.

    Attributes:
        text: Which margin it is; may be empty.
        unit: Its unit; may be empty.
    """

    text: str
    unit: str


class AbstractNamedMargins(AbstractMargins):
    """Margins that leave out absent agents by themselves and can say what each of their columns is."""

    @abc.abstractmethod
    def masked(self, mask: Mask) -> "AbstractNamedMargins":
        """The same margins of the agents that are present; the others have none, and infinite margins."""

    @abc.abstractmethod
    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        """Name and unit of a column.

        Args:
            column: Index of the column.
            columns: Number of columns.
            agents: Names of the agents.
        """


class FunctionMargins(AbstractMargins):
    """Margins by a plain function, for the agents of a mask."""

    function: Margins
    name: str = eqx.field(static=True)
    mask: Mask = None

    def __call__(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """The function's value, looked at: floating-point numbers, one row per agent."""
        margins = self.function(z, condition)
        is_array = isinstance(margins, jax.Array | np.ndarray)
        if not is_array or not jnp.issubdtype(margins.dtype, jnp.floating):
            kind = margins.dtype if is_array else type(margins).__name__
            raise TypeError(
                f"`margins` of {self.name!r} must be signed floating-point distances, >= 0 where they hold; got {kind}. "
                "A comparison such as `h >= 0` has no distance and no gradient: return `h` itself."
            )
        if margins.ndim != 2 or margins.shape[0] != z.shape[0] or not margins.shape[1]:
            raise ValueError(
                f"`margins` of {self.name!r} must have shape (agents, margins), one row for each of {z.shape[0]} agents; "
                f"got {margins.shape}."
            )
        if self.mask is None:
            return margins
        return jnp.where(self.mask[:, None], margins, jnp.inf)

    def violation(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j of each agent."""
        return jnp.sum(jnp.maximum(buffer - self(z, condition), 0.0) ** 2, axis=-1) / 2

    def dependence(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        """By reverse mode, one pass for each owner: who can change V_j to first order, and j itself."""
        slopes = jax.jacrev(lambda z: self.violation(z, condition, buffer))(z)
        return jnp.any(slopes != 0, axis=-1) | jnp.eye(len(z), dtype=bool)


def hinge_violation(margins: Margins, buffer: float) -> Callable[..., AgentValues]:
    """V_j(z, condition) = sum_k max(buffer - h_jk, 0)^2 / 2 from margins h_jk (`>= 0`: satisfied).

    `V <= buffer^2 / 2` implies every h_jk >= 0, so the buffer pays for discretisation.

    Source: paper, Task 2.
    """
    own = FunctionMargins(margins, "hinge_violation")
    return lambda z, condition: own.violation(z, condition, buffer)


def safe_norm(vector: Float[Array, "*shape dim"]) -> Float[Array, "*shape"]:
    """Euclidean length along the last axis, with a gradient of zero at the zero vector.

    The gradient of `jnp.linalg.norm` is not a number there, and stays so behind any `where` that comes after it: the
    usual trap of `norm(z_i - z_j)` on the diagonal.

    Example:
        >>> jax.grad(lambda x: safe_norm(x))(jnp.zeros(2))
        Array([0., 0.], dtype=float32)
    """
    square = jnp.sum(vector**2, axis=-1)
    zero = square == 0  # not so for nan, which stays what it is
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def distances(z: States, mask: Mask = None) -> Float[Array, "agents agents"]:
    """Distance of every agent to every other one, infinite to itself and to absent agents; safe to differentiate.

    Args:
        z: Positions, or states whose Euclidean distance is meant.
        mask: Which agents are present; None: all.

    Example:
        >>> distances(jnp.array([[0.0, 0.0], [3.0, 4.0]]))
        Array([[inf,  5.],
               [ 5., inf]], dtype=float32)
    """
    apart = safe_norm(z[:, None] - z[None])
    none = jnp.eye(len(z), dtype=bool)
    if mask is not None:
        none |= ~(mask[:, None] & mask[None])
    return jnp.where(none, jnp.inf, apart)
