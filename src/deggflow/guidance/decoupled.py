"""Guidance of a team: requirements in, one input per agent out."""

import abc
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .active_set import resolution
from .qp import MinNormInput, check_limits, min_norm_input
from .requirement import AbstractRequirement, ControlMap, Rows
from .sharing import DELTA, effective_directions


class GuidanceReport(NamedTuple):
    """What happened in one evaluation of the guidance, per sample."""

    value: Float[Array, " rows"]  # V or q of each requirement
    bound: Float[Array, " rows"]  # what the theorem promises of it
    limit: Float[Array, " rows"]  # what a discrete step may reach
    able: Bool[Array, "rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, " agents"]  # no input of this agent meets its rows
    effort: Float[Array, " agents"]  # |u_i|
    length: Float[Array, "rows agents"]  # |ell| where the agent must act (b > 0), else infinite
    active: Bool[Array, "rows agents"]  # the row decides the input: it is met with equality
    sine: Float[Array, " agents"]  # least sine between opposed rows that must be met, else 1


TIGHT = 1e-4  # of |ell| |u| + |b|: rows met as closely are active


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
        rows, zeros = jnp.zeros((0, agents)), jnp.zeros(agents)
        able = jnp.zeros((0, agents), bool)
        nothing = GuidanceReport(none, none, none, able, no, zeros, rows, able, zeros + 1)
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
        metric: H, one for all agents or one per agent; None is the identity.
        box: Largest size of each entry of an input; None for no limit.
        norm: Largest `sqrt(u @ H @ u)` of an input; None for no limit.
        delta: Half width of the blend in phi_delta, where an agent has two rows.

    Source: paper, eqn:control_affine, alg:guided_sampling.
    """

    requirements: tuple[AbstractRequirement, ...]
    control: ControlMap | None = None
    metric: Float[Array, "inputs inputs"] | Float[Array, "agents inputs inputs"] | None = None
    box: float | None = eqx.field(static=True, default=None)
    norm: float | None = eqx.field(static=True, default=None)
    delta: float = eqx.field(static=True, default=DELTA)

    def __check_init__(self) -> None:
        if not 0 < self.delta < 1:
            raise ValueError(f"`delta` must be in (0, 1) (paper, phi_delta); got {self.delta}.")
        if not self.requirements:
            raise ValueError("`requirements` are none; the nominal generation has `NoGuidance()`.")
        check_limits(self.box, self.norm)

    @property
    def names(self) -> tuple[str, ...]:
        """What reports call the requirements, one name per row."""
        return tuple(name for requirement in self.requirements for name in requirement.names)

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> tuple[Any, ...]:
        return tuple(requirement.init(z0, condition) for requirement in self.requirements)

    def values(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, " rows"]:
        """V or q of every row."""
        return jnp.concatenate([each.values(tau, z, condition) for each in self.requirements])

    def rows(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> Rows:
        """The rows of every agent, of all requirements."""
        control = None if self.control is None else self.control(tau, z, condition)
        demands = [
            requirement.demand(own, tau, z, drift, control, condition, moving)
            for requirement, own in zip(self.requirements, state, strict=True)
        ]
        ell, rate, value, bound, limit = (
            jnp.concatenate([getattr(demand, name) for demand in demands])
            for name in ("ell", "rate", "value", "bound", "limit")
        )
        reach = jnp.sum(effective_directions(ell, self.delta) ** 2, axis=-1)
        # What rounding leaves of a direction that should vanish is none.
        least = resolution(ell.dtype) ** 2 * jnp.sum(ell**2, axis=-1)
        reach = jnp.where(reach > least, reach, 0.0)
        zeta = jnp.concatenate(
            [
                requirement.shares(demand, reach[part], z, condition, moving)
                for requirement, demand, part in zip(
                    self.requirements, demands, self._parts(), strict=True
                )
            ]
        )
        b = rate + zeta
        # prop:c2_feasibility and cor:PE_local_feasibility: who must act has an effective direction to act along.
        return Rows(ell, b, value, bound, limit, (b <= 0) | (reach > 0))

    def _parts(self) -> list[slice]:
        """Which rows are whose."""
        ends = [0, *accumulate(len(requirement.names) for requirement in self.requirements)]
        return [slice(first, last) for first, last in pairwise(ends)]

    def __call__(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> tuple[Float[Array, "agents dim"], GuidanceReport]:
        rows = self.rows(state, tau, z, drift, condition, moving)
        u, feasible = jax.vmap(self.solve, in_axes=(1, 1, self._metric_axis))(
            rows.ell, rows.b, self.metric
        )
        effort = jnp.linalg.norm(u, axis=-1)
        active = _active(rows, u, effort)
        length = jnp.where(rows.b > 0, jnp.sqrt(jnp.sum(rows.ell**2, axis=-1)), jnp.inf)
        report = GuidanceReport(
            rows.value, rows.bound, rows.limit, rows.able, ~feasible, effort,
            length, active, least_sine(rows.ell, active),
        )  # fmt: skip
        if self.control is None:
            return u, report
        return jnp.einsum("adm,am->ad", self.control(tau, z, condition), u), report

    @property
    def _metric_axis(self) -> int | None:
        return 0 if self.metric is not None and self.metric.ndim == 3 else None

    def solve(
        self,
        ell: Float[Array, "rows inputs"],
        b: Float[Array, " rows"],
        metric: Float[Array, "inputs inputs"] | None,
    ) -> MinNormInput:
        """The input of one agent from its own rows and its own metric."""
        return min_norm_input(ell, b, metric, box=self.box, norm=self.norm)

    def metric_of(self, agent: Int[Array, ""]) -> Float[Array, "inputs inputs"] | None:
        """H of one agent."""
        return (
            self.metric if self.metric is None or self._metric_axis is None else self.metric[agent]
        )

    def landed(
        self,
        state: tuple[Any, ...],
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> tuple[Any, ...]:
        return tuple(
            requirement.landed(own, tau, value[part], above[part])
            for requirement, own, part in zip(self.requirements, state, self._parts(), strict=True)
        )


def _active(
    rows: Rows, u: Float[Array, "agents inputs"], effort: Float[Array, " agents"]
) -> Bool[Array, "rows agents"]:
    """Rows that are met with equality by an input that is not zero."""
    length = jnp.sqrt(jnp.sum(rows.ell**2, axis=-1))
    slack = jnp.sum(rows.ell * u[None], axis=-1) + rows.b
    tight = slack >= -TIGHT * (length * effort[None] + jnp.abs(rows.b))
    return (effort > 0)[None] & (length > 0) & tight


def least_sine(
    ell: Float[Array, "rows agents inputs"], counts: Bool[Array, "rows agents"]
) -> Float[Array, " agents"]:
    """Least sine between two opposed rows of an agent that both count, else 1.

    Where it is small the two can hardly be met together, and inputs become large.
    """
    square = jnp.sum(ell**2, axis=-1, keepdims=True)
    unit = ell / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    least = jnp.ones(ell.shape[1])
    for k in range(1, len(ell)):
        # For an angle of pi - s, |along| = 2 sin(s / 2): digits that 1 - cos^2 would have lost.
        along, across = unit[:k] + unit[k : k + 1], unit[:k] - unit[k : k + 1]
        sine = jnp.sqrt(jnp.sum(along**2, axis=-1) * jnp.sum(across**2, axis=-1)) / 2
        opposed = jnp.sum(unit[:k] * unit[k : k + 1], axis=-1) < 0
        both = counts[:k] & counts[k : k + 1] & opposed
        least = jnp.minimum(least, jnp.min(jnp.where(both, sine, 1.0), axis=0))
    return least
