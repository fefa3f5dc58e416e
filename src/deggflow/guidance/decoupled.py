"""Guidance of a team: requirements in, one input per agent out."""

import abc
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States

from .active_set import resolution
from .directions import DELTA, effective_directions
from .metric import check_metric
from .qp import MinNormInput, check_limits, min_norm_input
from .report import GuidanceReport, not_finite, report_without_rows
from .requirement import (
    AbstractRequirement,
    Control,
    ControlMap,
    Demand,
    MarginNames,
    Rows,
    correction,
)

TIGHT = 1e-4  # of |ell| |u| + |b|: rows met as closely are active


class AbstractGuidance(eqx.Module):
    """Guidance has the shape of a kernel: a state from z(0), then one call per point, which may change the state."""

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """What reports call the rows of the requirements; none if nothing is promised."""

    @abc.abstractmethod
    def init(self, z0: States, condition: Any, mask: Mask = None) -> Any:
        """State of one sample. `mask` is True for the agents that are present; None: all."""

    @abc.abstractmethod
    def __call__(
        self, state: Any, tau: Scalar, z: States, drift: States, condition: Any, moving: Mask = None
    ) -> tuple[Any, States, GuidanceReport]:
        """The state after this point, the correction g_i u_i of every agent, added to the nominal field, and a report.

        Schemes of several stages call it between points, too; of those calls the state is not kept.

        Agents for which `moving` is False have stopped or are absent: they get no input, the others take their shares.
        """

    @abc.abstractmethod
    def on_forced_step(self, state: Any, tau: Scalar, value: RowValues, above: RowFlags) -> Any:
        """The state after a step that was taken although it ended above limits."""


class NoGuidance(AbstractGuidance):
    """The nominal generation, u = 0."""

    @property
    def names(self) -> tuple[str, ...]:
        return ()

    def init(self, z0: States, condition: Any, mask: Mask = None) -> None:
        return None

    def __call__(
        self, state: Any, tau: Scalar, z: States, drift: States, condition: Any, moving: Mask = None
    ) -> tuple[None, States, GuidanceReport]:
        none = jnp.zeros_like(z)
        return None, none, report_without_rows(drift, none)

    def on_forced_step(self, state: None, tau: Scalar, value: RowValues, above: RowFlags) -> None:
        return None


class DecoupledGuidance(AbstractGuidance):
    """Each agent solves its own small QP over its rows, without knowing any other agent's input.

    Attributes:
        requirements: A tuple of shared and private ones in any number; each agent meets all of its rows at once.
        control: g, one matrix per agent or its diagonal; None is the identity.
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
        check_requirements(self.requirements)
        if self.control is not None and not callable(self.control):
            raise TypeError(
                f"`control` must be a function (tau, z, condition) -> (agents, dim, inputs) or (agents, dim); got {type(self.control).__name__}."
            )
        check_limits(self.box, self.norm)
        check_metric(self.metric)

    @property
    def names(self) -> tuple[str, ...]:
        """What reports call the requirements, one name per row."""
        return tuple(name for requirement in self.requirements for name in requirement.names)

    def init(self, z0: States, condition: Any, mask: Mask = None) -> tuple[Any, ...]:
        return tuple(requirement.init(z0, condition, mask) for requirement in self.requirements)

    def values(self, tau: Scalar, z: States, condition: Any, mask: Mask = None) -> RowValues:
        """V or q of every row."""
        return jnp.concatenate([each.values(tau, z, condition, mask) for each in self.requirements])

    def margins_at_end(
        self, z: States, condition: Any, mask: Mask = None
    ) -> tuple[Float[Array, "..."], ...]:
        """The verdict of every row on z(1), as `AbstractRequirement.margins_at_end`."""
        each = [each.margins_at_end(z, condition, mask) for each in self.requirements]
        return tuple(margins for own in each for margins in own)

    def margin_names(self) -> tuple[MarginNames | None, ...]:
        """Names of every row's margins."""
        return tuple(
            requirement.margin_names(row)
            for requirement in self.requirements
            for row in range(len(requirement.names))
        )

    def rows(
        self,
        state: tuple[Any, ...],
        tau: Scalar,
        z: States,
        drift: States,
        condition: Any,
        moving: Mask = None,
    ) -> Rows:
        """The rows of every agent, of all requirements."""
        control = self._control(tau, z, condition)
        demands = [
            requirement.demand(own, tau, z, drift, control, condition, moving)
            for requirement, own in zip(self.requirements, state, strict=True)
        ]
        ell, rate, explicit, value, bound, limit, contribution, value_nan = (
            jnp.concatenate([getattr(demand, name) for demand in demands])
            for name in Demand._fields[:-1]
        )
        square = jnp.sum(effective_directions(ell, self.delta) ** 2, axis=-1)
        # What rounding leaves of a direction that should vanish is none.
        least = resolution(ell.dtype) ** 2 * jnp.sum(ell**2, axis=-1)
        square = jnp.where(square > least, square, 0.0)
        zeta = jnp.concatenate(
            [
                demand.shares(square[part])
                for demand, part in zip(demands, self._parts(), strict=True)
            ]
        )
        b = rate + zeta
        return Rows(
            ell=ell,
            b=b,
            value=value,
            bound=bound,
            limit=limit,
            # prop:c2_feasibility and cor:PE_local_feasibility: who must act has an effective direction to act along.
            row_feasible=(b <= 0) | (square > 0),
            rate=jnp.sum(rate, axis=-1) + explicit,
            contribution=contribution,
            value_nan=value_nan,
            gradient_nan=jnp.any(jnp.isnan(ell), axis=-1),
        )

    def _control(self, tau: Scalar, z: States, condition: Any) -> Control:
        if self.control is None:
            return None
        control = self.control(tau, z, condition)
        if jnp.ndim(control) not in (2, 3) or control.shape[:2] != z.shape:
            raise ValueError(
                "`control` must return one matrix per agent, of shape "
                f"({z.shape[0]}, {z.shape[1]}, inputs), or diagonals {z.shape}; got {jnp.shape(control)}."
            )
        return control.astype(z.dtype)

    def _parts(self) -> list[slice]:
        """Which rows are whose."""
        ends = [0, *accumulate(len(requirement.names) for requirement in self.requirements)]
        return [slice(first, last) for first, last in pairwise(ends)]

    def __call__(
        self,
        state: tuple[Any, ...],
        tau: Scalar,
        z: States,
        drift: States,
        condition: Any,
        moving: Mask = None,
    ) -> tuple[tuple[Any, ...], States, GuidanceReport]:
        rows = self.rows(state, tau, z, drift, condition, moving)
        self._check_metric_fits(len(z), rows.ell.shape[-1])
        u, feasible = jax.vmap(self.solve, in_axes=(1, 1, self._metric_axis))(
            rows.ell, rows.b, self.metric
        )
        u = u.astype(z.dtype)
        report = report_of(rows, u, feasible, drift)
        return state, correction(self._control(tau, z, condition), u), report

    def _check_metric_fits(self, agents: int, inputs: int) -> None:
        if self.metric is None:
            return
        allowed = (inputs, inputs), (agents, inputs, inputs)
        if self.metric.shape not in allowed:
            raise ValueError(
                f"`metric` must have shape {allowed[0]}, or {allowed[1]} with one matrix per agent; got {self.metric.shape}."
            )

    @property
    def _metric_axis(self) -> int | None:
        return 0 if self.metric is not None and self.metric.ndim == 3 else None

    def solve(
        self,
        ell: Float[Array, "rows inputs"],
        b: RowValues,
        metric: Float[Array, "inputs inputs"] | None,
    ) -> MinNormInput:
        """The input of one agent from its own rows and its own metric."""
        metric = None if metric is None else metric.astype(ell.dtype)
        return min_norm_input(ell, b, metric, box=self.box, norm=self.norm)

    def metric_of(self, agent: Int[Array, ""]) -> Float[Array, "inputs inputs"] | None:
        """H of one agent."""
        return (
            self.metric if self.metric is None or self._metric_axis is None else self.metric[agent]
        )

    def on_forced_step(
        self, state: tuple[Any, ...], tau: Scalar, value: RowValues, above: RowFlags
    ) -> tuple[Any, ...]:
        return tuple(
            requirement.on_forced_step(own, tau, value[part], above[part])
            for requirement, own, part in zip(self.requirements, state, self._parts(), strict=True)
        )


def check_requirements(requirements: tuple[AbstractRequirement, ...]) -> None:
    """Raises `TypeError` or `ValueError` unless they are a tuple of requirements, each row with a name of its own."""
    if isinstance(requirements, AbstractRequirement):
        raise TypeError(
            "`requirements` must be a tuple; got one requirement: write `(requirement,)`."
        )
    if not isinstance(requirements, tuple) or not all(
        isinstance(each, AbstractRequirement) for each in requirements
    ):
        raise TypeError(f"`requirements` must be a tuple of requirements; got {requirements!r}.")
    if not requirements:
        raise ValueError("`requirements` are none; the nominal generation has `NoGuidance()`.")
    names = [name for requirement in requirements for name in requirement.names]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"`requirements` must have names of their own, by which certificates tell them apart; got {name!r} "
                f"{names.count(name)} times: pass `name=`."
            )


def report_of(
    rows: Rows,
    u: Float[Array, "agents inputs"],
    feasible: Bool[Array, " agents"],
    drift: States,
) -> GuidanceReport:
    """What happened in one evaluation, from the rows, the inputs, whether these meet the rows, and the drift."""
    input_norm, ell_norm = jnp.linalg.norm(u, axis=-1), jnp.sqrt(jnp.sum(rows.ell**2, axis=-1))
    active = _active(rows, ell_norm, u, input_norm)
    return GuidanceReport(
        value=rows.value, bound=rows.bound, limit=rows.limit, row_feasible=rows.row_feasible,
        qp_infeasible=~feasible, input_norm=input_norm,
        ell_norm=jnp.where(rows.b > 0, ell_norm, jnp.inf), active=active,
        opposed_sine=opposed_sine(rows.ell, active),
        slope=rows.rate + jnp.sum(rows.ell * u[None], axis=(1, 2)),
        contribution=rows.contribution, drift_nan=not_finite(drift),
        value_nan=rows.value_nan, gradient_nan=rows.gradient_nan,
        input_nan=jnp.any(jnp.isnan(u), axis=-1),
    )  # fmt: skip


def _active(
    rows: Rows,
    ell_norm: Float[Array, "rows agents"],
    u: Float[Array, "agents inputs"],
    input_norm: Float[Array, " agents"],
) -> Bool[Array, "rows agents"]:
    """Rows that are met with equality by an input that is not zero."""
    slack = jnp.sum(rows.ell * u[None], axis=-1) + rows.b
    tight = slack >= -TIGHT * (ell_norm * input_norm[None] + jnp.abs(rows.b))
    return (input_norm > 0)[None] & (ell_norm > 0) & tight


def opposed_sine(
    ell: Float[Array, "rows agents inputs"], counts: Bool[Array, "rows agents"]
) -> Float[Array, " agents"]:
    """Least sine between two opposed rows of an agent that both count, else 1.

    Where it is small the two can hardly be met together, and inputs become large.
    """
    square = jnp.sum(ell**2, axis=-1, keepdims=True)
    unit = ell / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    least = jnp.ones(ell.shape[1], ell.dtype)
    for k in range(1, len(ell)):
        # For an angle of pi - s, |along| = 2 sin(s / 2): digits that 1 - cos^2 would have lost.
        along, across = unit[:k] + unit[k : k + 1], unit[:k] - unit[k : k + 1]
        sine = jnp.sqrt(jnp.sum(along**2, axis=-1) * jnp.sum(across**2, axis=-1)) / 2
        opposed = jnp.sum(unit[:k] * unit[k : k + 1], axis=-1) < 0
        both = counts[:k] & counts[k : k + 1] & opposed
        least = jnp.minimum(least, jnp.min(jnp.where(both, sine, 1.0), axis=0))
    return least


def as_guidance(
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
) -> DecoupledGuidance:
    """Guidance by these requirements; guidance itself is returned unchanged."""
    if isinstance(requirements, DecoupledGuidance):
        return requirements
    # One requirement without a tuple is refused by `DecoupledGuidance` itself.
    items: Any = tuple(requirements) if isinstance(requirements, list) else requirements
    return DecoupledGuidance(items)
