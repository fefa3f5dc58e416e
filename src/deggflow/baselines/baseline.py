"""Base classes and constraints shared by the baselines, which are guidance without rows."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import AbstractGuidance, GuidanceReport, report_without_rows
from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States

Constraints = Callable[[States, Any], Float[Array, " constraints"]]
"""h: (z, condition) -> one margin per constraint, `>= 0` where it holds, without duplicate constraints."""

# Least time left, so that gains in 1 / (1 - tau) stay finite at tau = 1, after which no step follows.
MIN_TIME_LEFT = 1e-6


class AbstractBaseline(AbstractGuidance):
    """An alternative method with the interface of `DecoupledGuidance`, without guarantees on requirement values."""

    @property
    def names(self) -> tuple[str, ...]:
        """Empty, as baselines have no rows."""
        return ()

    def on_forced_step(self, state: Any, tau: Scalar, value: RowValues, above: RowFlags) -> Any:
        """The unchanged state, as baselines have no limits."""
        return state


class AbstractStateless(AbstractBaseline):
    """A baseline whose correction depends on the current sample only."""

    @abc.abstractmethod
    def correction(self, tau: Scalar, z: States, drift: States, condition: Any) -> States:
        """The input that is added to the nominal field."""

    def init(self, z0: States, condition: Any, mask: Mask = None) -> None:
        """None, as there is no state."""

    def __call__(
        self, state: Any, tau: Scalar, z: States, drift: States, condition: Any, moving: Mask = None
    ) -> tuple[None, States, GuidanceReport]:
        """The correction, and a report without rows, which contains only the norms of inputs."""
        u = of_moving(self.correction(tau, z, drift, condition), moving)
        return None, u, report_without_rows(drift, u)


def of_moving(u: States, moving: Mask) -> States:
    """Inputs of the moving agents; zero for the others."""
    return u if moving is None else jnp.where(moving[:, None], u, 0.0)


class Linearised(NamedTuple):
    """Constraints linearised at one state.

    Attributes:
        margin: h.
        slope: dh/dz.
        rate: dh/dtau along the nominal field.
    """

    margin: Float[Array, " constraints"]
    slope: Float[Array, "constraints agents dim"]
    rate: Float[Array, " constraints"]


def linearise(constraints: Constraints, z: States, drift: States, condition: Any) -> Linearised:
    """Margins, their slopes and their rates along the nominal field."""

    def margins(z: States) -> Float[Array, " constraints"]:
        return constraints(z, condition)

    margin, push = jax.linearize(margins, z)
    # Forward mode, as a team has fewer coordinates than constraints.
    basis = jnp.eye(z.size, dtype=z.dtype).reshape(-1, *z.shape)
    slope = jnp.moveaxis(jax.vmap(push)(basis), 0, -1).reshape(len(margin), *z.shape)
    return Linearised(margin, slope, jnp.sum(slope * drift[None], axis=(1, 2)))


def time_left(tau: Scalar) -> Scalar:
    """1 - tau, at least `MIN_TIME_LEFT`."""
    return jnp.maximum(1 - tau, MIN_TIME_LEFT)
