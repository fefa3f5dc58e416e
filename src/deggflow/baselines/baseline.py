"""What the baselines share: guidance without rows, and how constraints are given to it."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.guidance import AbstractGuidance, GuidanceReport, report_without_rows

Constraints = Callable[[Float[Array, "agents dim"], Any], Float[Array, " constraints"]]
"""h: (z, condition) -> one margin per constraint, `>= 0` where it holds; each constraint counts once."""

SHORTEST = 1e-6  # of tau: gains in 1 / (1 - tau) stay finite at tau = 1, where no step follows


class AbstractBaseline(AbstractGuidance):
    """Another way to guide, behind the interface of `DecoupledGuidance`; nothing is promised of its values."""

    @property
    def names(self) -> tuple[str, ...]:
        """No rows."""
        return ()

    def on_forced_step(
        self,
        state: Any,
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> Any:
        """No limits: the state as it is."""
        return state


class AbstractStateless(AbstractBaseline):
    """A baseline whose correction follows from the sample alone."""

    @abc.abstractmethod
    def correction(
        self,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, "agents dim"]:
        """What is added to the nominal field."""

    def init(
        self,
        z0: Float[Array, "agents dim"],
        condition: Any,
        mask: Bool[Array, " agents"] | None = None,
    ) -> None:
        """No state."""

    def __call__(
        self,
        state: None,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> tuple[None, Float[Array, "agents dim"], GuidanceReport]:
        """The correction, and a report without rows: efforts alone."""
        u = of_moving(self.correction(tau, z, drift, condition), moving)
        return None, u, report_without_rows(drift, u)


def of_moving(
    u: Float[Array, "agents dim"], moving: Bool[Array, " agents"] | None
) -> Float[Array, "agents dim"]:
    """Inputs of the agents that move; zero for the others."""
    return u if moving is None else jnp.where(moving[:, None], u, 0.0)


class Linearised(NamedTuple):
    """Constraints to first order at one state."""

    margin: Float[Array, " constraints"]  # h
    slope: Float[Array, "constraints agents dim"]  # dh/dz
    rate: Float[Array, " constraints"]  # what the nominal field does to h


def linearise(
    constraints: Constraints,
    z: Float[Array, "agents dim"],
    drift: Float[Array, "agents dim"],
    condition: Any,
) -> Linearised:
    """Margins, their slopes and their rates along the nominal field."""

    def margins(z: Float[Array, "agents dim"]) -> Float[Array, " constraints"]:
        return constraints(z, condition)

    margin, push = jax.linearize(margins, z)
    # Forward mode: a team has fewer coordinates than constraints.
    basis = jnp.eye(z.size, dtype=z.dtype).reshape(-1, *z.shape)
    slope = jnp.moveaxis(jax.vmap(push)(basis), 0, -1).reshape(len(margin), *z.shape)
    return Linearised(margin, slope, jnp.sum(slope * drift[None], axis=(1, 2)))


def left(tau: Float[Array, ""]) -> Float[Array, ""]:
    """1 - tau, not zero."""
    return jnp.maximum(1 - tau, SHORTEST)
