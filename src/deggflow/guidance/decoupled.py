"""Guidance of a team: requirements in, one input per agent out."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .qp import min_norm_input
from .requirement import AbstractRequirement, ControlMap


class GuidanceReport(NamedTuple):
    """What happened in one evaluation of the guidance, per sample."""

    value: Float[Array, " rows"]  # V or q of each requirement
    bound: Float[Array, " rows"]  # what the theorem promises of it
    limit: Float[Array, " rows"]  # what a discrete step may reach
    able: Bool[Array, "rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, " agents"]  # no input of this agent meets its rows
    effort: Float[Array, " agents"]  # |u_i|


class AbstractGuidance(eqx.Module):
    """Guidance has the shape of a kernel: a state from z(0), then one call per step."""

    @abc.abstractmethod
    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> Any:
        """State of one sample."""

    @abc.abstractmethod
    def __call__(
        self,
        state: Any,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> tuple[Float[Array, "agents dim"], GuidanceReport]:
        """The correction g_i u_i of every agent, added to the nominal field, and a report.

        Agents for which `moving` is False have stopped: they get no input, the others take their shares.
        """

    @abc.abstractmethod
    def landed(
        self,
        state: Any,
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> Any:
        """The state after a step that was taken although values landed above their limits."""


class NoGuidance(AbstractGuidance):
    """The nominal generation, u = 0."""

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> None:
        return None

    def __call__(
        self,
        state: None,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> tuple[Float[Array, "agents dim"], GuidanceReport]:
        agents = z.shape[0]
        none, no = jnp.zeros(0), jnp.zeros(agents, bool)
        able = jnp.zeros((0, agents), bool)
        nothing = GuidanceReport(none, none, none, able, no, jnp.zeros(agents))
        return jnp.zeros_like(z), nothing

    def landed(
        self,
        state: None,
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> None:
        return None


class DecoupledGuidance(AbstractGuidance):
    """Each agent solves its own small QP over its rows, without knowing any other agent's input.

    Args:
        requirements: Shared and private ones in any number; each agent meets all of its rows at once.
        control: g, one matrix per agent; None is the identity.
        metric: H, common to the agents; None is the identity.

    Source: paper, eqn:control_affine, alg:guided_sampling.
    """

    requirements: tuple[AbstractRequirement, ...]
    control: ControlMap | None = None
    metric: Float[Array, "inputs inputs"] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """What reports call the requirements, one name per row."""
        return tuple(name for requirement in self.requirements for name in requirement.names)

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> tuple[Any, ...]:
        return tuple(requirement.init(z0, condition) for requirement in self.requirements)

    def __call__(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> tuple[Float[Array, "agents dim"], GuidanceReport]:
        control = None if self.control is None else self.control(tau, z, condition)
        rows = [
            requirement.rows(own, tau, z, drift, control, condition, moving)
            for requirement, own in zip(self.requirements, state, strict=True)
        ]
        ell = jnp.concatenate([row.ell for row in rows])
        b = jnp.concatenate([row.b for row in rows])
        solve = jax.vmap(lambda ell, b: min_norm_input(ell, b, self.metric), in_axes=1)
        u, feasible = solve(ell, b)
        value, bound, limit, able = (
            jnp.concatenate([getattr(row, name) for row in rows])
            for name in ("value", "bound", "limit", "able")
        )
        effort = jnp.linalg.norm(u, axis=-1)
        report = GuidanceReport(value, bound, limit, able, ~feasible, effort)
        correction = u if control is None else jnp.einsum("adm,am->ad", control, u)
        return correction, report

    def landed(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> tuple[Any, ...]:
        after, first = [], 0
        for requirement, own in zip(self.requirements, state, strict=True):
            part = slice(first, first + len(requirement.names))
            after.append(requirement.landed(own, tau, value[part], above[part]))
            first = part.stop
        return tuple(after)
