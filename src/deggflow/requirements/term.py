"""What every named requirement is made of: exact margins for the verdict, hinges for guidance, and labels."""

import abc
from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.guidance import AbstractNamedMargins
from deggflow.shapes import AgentValues, Mask, States

from .layout import POINTS, Layout

EPS = 0.05  # of a buffer, by which smoothed distances may fall short of the exact ones

Term = TypeVar("Term", bound="AbstractTerm")


class AbstractTerm(AbstractNamedMargins):
    """One kind of requirement. V_j at most buffer^2 / 2 implies that every exact margin of agent j is nonnegative.

    The verdict is made of `exact`, in float64. Guidance brings down the sum of `hinges`, which are smooth where the
    exact margins have kinks, and which are not computed by the same code.

    Attributes:
        layout: How states are read.
        mask: Agents that are present; None: all.
    """

    layout: Layout = eqx.field(kw_only=True, default=POINTS)
    mask: Mask = eqx.field(kw_only=True, default=None)

    @abc.abstractmethod
    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """Margins, in the term's unit; absent agents may have any."""

    @abc.abstractmethod
    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j, in the squared unit; absent agents may have any."""

    @abc.abstractmethod
    def active(
        self, z: States, condition: Any, buffer: float
    ) -> Bool[Array, "owners agents"] | None:
        """Whose states each V_j depends on now besides its own; None: nobody's."""

    def masked(self: Term, mask: Mask) -> Term:
        return replace(self, mask=mask)

    def __call__(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """Exact margins, infinite for absent agents."""
        margins = self.exact(z, condition)
        return margins if self.mask is None else jnp.where(self.mask[:, None], margins, jnp.inf)

    def violation(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j of each agent, zero for absent agents."""
        values = self.hinges(z, condition, buffer)
        return values if self.mask is None else jnp.where(self.mask, values, 0.0)

    def dependence(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        """Whose states each V_j depends on now."""
        own = jnp.eye(len(z), dtype=bool)
        others = self.active(z, condition, buffer)
        return own if others is None else own | others


class AbstractOwnTerm(AbstractTerm):
    """A term in which each agent's margins depend on its own state alone."""

    def active(self, z: States, condition: Any, buffer: float) -> None:
        return None


class AbstractPairTerm(AbstractTerm):
    """A term of pairs of agents: both own the margin of a pair, and each depends on those that are too close."""

    @abc.abstractmethod
    def _pairs(
        self, z: States, condition: Any, buffer: float
    ) -> tuple[Float[Array, "pairs steps"], Float[np.ndarray, "pairs agents"]]:
        """Hinges of every pair, and ones at its two agents."""

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        values, member = self._pairs(z, condition, buffer)
        return jnp.asarray(member.T, z.dtype) @ jnp.sum(values, axis=1)

    def active(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        values, member = self._pairs(z, condition, buffer)
        together = jnp.asarray(member.T, z.dtype) * (jnp.sum(values, axis=1) > 0)[None]
        return together @ jnp.asarray(member, z.dtype) > 0


def hinge(excess: Float[Array, "..."]) -> Float[Array, "..."]:
    """max(excess, 0)^2 / 2."""
    # A choice, not `jnp.maximum`: half the kernels in its gradient.
    return jnp.where(excess > 0, excess, 0.0) ** 2 / 2


def dot(a: Float[Array, "axes ..."], b: Float[Array, "axes ..."]) -> Float[Array, "..."]:
    """Inner product along the first axis, term by term: XLA's CPU backend fuses that, and sums over an axis less well."""
    total = a[0] * b[0]
    for k in range(1, len(a)):
        total = total + a[k] * b[k]
    return total


def root(square: Float[Array, "..."]) -> Float[Array, "..."]:
    """Square root with a gradient of zero at zero."""
    zero = square == 0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def length(vector: Float[Array, "axes ..."]) -> Float[Array, "..."]:
    """Euclidean length along the first axis, with a gradient of zero at the zero vector."""
    return root(dot(vector, vector))


def nearest_on_the_way(
    start: Float[Array, "axes ..."], way: Float[Array, "axes ..."], eps: float
) -> Float[Array, "..."]:
    """Distance of the origin to segments `start + s way`, from below by at most `eps`, continuously differentiable.

    min over s in [0, 1] of |start + s way|^2 + (2 eps)^2 (s - 1/2)^2 has a unique minimiser even for a segment that is a
    point, so its gradient is that at the minimiser held fixed (Danskin). It exceeds the squared distance by at most eps^2.
    """
    square, along = dot(way, way), dot(start, way)
    weight = 4 * eps**2
    total = square + weight if weight > 0 else jnp.where(square > 0, square, 1.0)
    s = jax.lax.stop_gradient(jnp.clip((weight / 2 - along) / total, 0.0, 1.0))
    nearest = start + s[None] * way
    return root(dot(nearest, nearest) + weight * (s - 0.5) ** 2) - eps
