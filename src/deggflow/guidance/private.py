"""Private requirements (PE guidance): each agent owns a violation that its neighbours also affect."""

import math
from dataclasses import fields, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States

from .allocation import AbstractAllocation, Pooled
from .margins import (
    AbstractMargins,
    AbstractNamedMargins,
    FunctionMargins,
    MarginLabel,
    Margins,
)
from .requirement import (
    AbstractRequirement,
    Control,
    Demand,
    MarginNames,
    check_buffer,
    check_unrounded,
    input_gradient,
    plain_number,
)
from .schedule import AbstractSchedule, LinearSchedule
from .sums import SumOfMargins

MIN_REMAINING = 0.01  # floor of the remaining integral of omega, where re-anchoring divides by it
MIN_VIOLATION = 1e-30  # floor of V(0) in c (paper, Task 2)


class PrivateState(NamedTuple):
    """Where the bound on V starts, and for which agents.

    Attributes:
        start: V(0).
        anchor: V at `since`.
        since: 0, or the tau at which a step last ended above its limit.
        mask: True for the agents that are present; None: all.
    """

    start: Scalar
    anchor: Scalar
    since: Scalar
    mask: Mask


class PrivateRequirement(AbstractRequirement):
    """Margins that each agent must have at the end, h_jk >= 0; guidance drives V = sum_j V_j to zero by tau = 1.

    V_j = sum_k max(buffer - h_jk, 0)^2 / 2 vanishes where every margin is at least the buffer, and V at most
    `floor = buffer^2 / 2` already implies every h_jk >= 0: the buffer pays for discrete steps. The verdict on a finished
    sample is of the margins themselves, in float64.

    Each owner calls for a decrease of c omega V_j^rho, shared out by `allocation`. The paper fixes c from
    V(0). With `reanchored`, c is taken afresh from the present,
    c(tau) = kappa V^(1 - rho) / ((1 - rho) int_tau^1 omega), so that after any disturbance
    V(tau) <= V(s) (int_tau^1 omega / int_s^1 omega)^(kappa / (1 - rho)): convergence in prescribed time.
    With `per_owner_gain`, each owner takes its c_j from its own V_j: the demands, linear in V_j then, add up to that of
    V exactly, and nobody has to know the team's V. (With one c for all, sum_j V_j^rho >= V^rho: the demand grows with
    the team, up to n^(1 - rho) times, and so do the steps' errors.)

    The sum of two private requirements asks for both and has one V, in which margins are measured in their own buffers,
    so that V at most 1/2 implies all of them. Their other settings must agree.

    Attributes:
        margins: h(z, condition) of shape (agents, margins), or an object that sums them faster.
        buffer: What guidance aims at above h = 0, in the unit of the margins.
        allocation: How agents divide the demand: `Pooled()`, `Local()`, `Own()` or `Fixed(weight)`.
        reanchored: Take c afresh from the present violation instead of V(0).
        per_owner_gain: Each owner's c from its own violation.
        rho: In (0, 1).
        kappa: At least 1; what it is above pays for discrete steps.
        omega: When violations are brought down.
        name: What reports call it.
        margin_labels: Names of the margins, one per column, for the reasons in certificates.

    Example:
        >>> apart = PrivateRequirement(lambda z, condition: distances(z) - 0.5, buffer=0.02, name="apart")
        >>> round(apart.floor, 6)
        0.0002

    Source: paper, thm:private_finite_time.
    """

    margins: Margins | AbstractMargins
    buffer: float = eqx.field(static=True, converter=plain_number)
    allocation: AbstractAllocation = Pooled()
    reanchored: bool = eqx.field(static=True, default=True)
    per_owner_gain: bool = eqx.field(static=True, default=False)
    rho: float = eqx.field(static=True, default=0.75)
    kappa: float = eqx.field(static=True, default=1.15)
    omega: AbstractSchedule = LinearSchedule()
    name: str = eqx.field(static=True, default="private")
    margin_labels: tuple[str, ...] | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        if not callable(self.margins):
            raise TypeError(
                f"`margins` must be a function (z, condition) -> (agents, margins); got {self.margins!r}."
            )
        check_buffer(self.buffer, "the margins", "h >= buffer")
        if not 0 < self.rho < 1:
            raise ValueError(
                f"`rho` must be in (0, 1) (finite-horizon theorem for PE guidance); got {self.rho}."
            )
        if not 1 <= self.kappa < math.inf:
            raise ValueError(
                "`kappa` must be at least 1 and finite, else c is too small for V to reach zero by tau = 1 "
                f"(finite-horizon theorem for PE guidance); got {self.kappa}."
            )
        if self.per_owner_gain and not self.reanchored:
            raise ValueError(
                "`per_owner_gain` needs `reanchored`: a V_j that is zero at first may grow, and its c_j with it."
            )

    @property
    def floor(self) -> float:
        """buffer^2 / 2, a value of V at which every margin is nonnegative; no step is refused for a V below it."""
        return self.buffer**2 / 2

    @property
    def names(self) -> tuple[str, ...]:
        return (self.name,)

    def __add__(self, other: "PrivateRequirement") -> "PrivateRequirement":
        if not isinstance(other, PrivateRequirement):
            return NotImplemented
        names = [
            each.name
            for each in fields(self)
            if each.name not in ("margins", "buffer", "name", "margin_labels")
        ]
        for name in names:
            one, two = getattr(self, name), getattr(other, name)
            if not eqx.tree_equal(one, two):
                raise ValueError(
                    f"`{name}` of {self.name!r} is {one}, of {other.name!r} {two}: the sum of two requirements has one V, so "
                    "these must agree; put requirements with settings of their own into a tuple."
                )
        whole = SumOfMargins.of(self._part(), other._part())
        name = f"{self.name} + {other.name}"
        return replace(self, margins=whole, buffer=1.0, name=name, margin_labels=None)

    def _part(self) -> SumOfMargins:
        if isinstance(self.margins, SumOfMargins):
            return self.margins
        labels = self.margin_labels or ()
        return SumOfMargins((self._judged(None),), (self.buffer,), (labels,))

    def _judged(self, mask: Mask) -> AbstractMargins:
        if isinstance(self.margins, AbstractNamedMargins):
            return self.margins.masked(mask)
        if isinstance(self.margins, AbstractMargins):
            return self.margins
        return FunctionMargins(self.margins, self.name, mask)

    def init(self, z0: States, condition: Any, mask: Mask = None) -> PrivateState:
        """V(0), from which c and the bound start."""
        total = self.violation(z0, condition, mask).astype(z0.dtype)
        return PrivateState(total, total, jnp.zeros_like(total), mask)

    def violation(self, z: States, condition: Any, mask: Mask = None) -> Scalar:
        """V = sum_j V_j, in the squared unit of the margins."""
        return jnp.sum(self._judged(mask).violation(z, condition, self.buffer))

    def _gain(self, total: Float[Array, "*agents"], remaining: Scalar) -> Float[Array, "*agents"]:
        return self.kappa / (1 - self.rho) * total ** (1 - self.rho) / remaining

    def bound(self, state: PrivateState, tau: Scalar) -> Scalar:
        """What V(tau) stays below: the theorem's bound, or that of the re-anchored gain."""
        return self._decayed(state, tau, self.kappa)

    def limit(self, state: PrivateState, tau: Scalar) -> Scalar:
        """The most that V may be after a discrete step to tau."""
        # kappa = 1 just reaches zero at tau = 1: what kappa gives beyond that may be spent on discretisation.
        return jnp.maximum(self._decayed(state, tau, 1.0), self.floor)

    def _decayed(self, state: PrivateState, tau: Scalar, kappa: float) -> Scalar:
        whole, rest = self.omega.remaining(state.since), self.omega.remaining(tau)
        fraction = jnp.where(whole > 0, rest / jnp.where(whole > 0, whole, 1.0), 0.0)
        if self.reanchored:
            return state.anchor * fraction ** (kappa / (1 - self.rho))
        # Of V(0)^(1 - rho), linear in the integral of omega.
        return state.anchor * jnp.maximum(1 - kappa * (1 - fraction), 0.0) ** (1 / (1 - self.rho))

    def values(self, tau: Scalar, z: States, condition: Any, mask: Mask = None) -> RowValues:
        return self.violation(z, condition, mask)[None]

    def margins_at_end(
        self, z: States, condition: Any, mask: Mask = None
    ) -> tuple[Float[Array, "..."], ...]:
        margins = self._judged(mask)(z, condition)
        check_unrounded(f"`margins` of {self.name!r} are", margins, z)
        return (margins,)

    def margin_names(self, row: int) -> MarginNames | None:
        if isinstance(self.margins, AbstractNamedMargins):
            return self.margins.label
        labels = self.margin_labels
        return None if labels is None else lambda k, _, __: MarginLabel(labels[k], "")

    def demand(
        self,
        state: PrivateState,
        tau: Scalar,
        z: States,
        drift: States,
        control: Control,
        condition: Any,
        moving: Mask = None,
    ) -> Demand:
        margins = self._judged(state.mask)
        parts, gradient = margins.violation_and_gradient(z, condition, self.buffer)
        parts = parts.astype(z.dtype)
        total = jnp.sum(parts)
        # Where the bound starts, it is this value: another program may have rounded it apart.
        state = state._replace(anchor=jnp.where(tau == state.since, total, state.anchor))
        if self.reanchored:
            whole = parts if self.per_owner_gain else total
            gain = self._gain(whole, jnp.maximum(self.omega.remaining(tau), MIN_REMAINING))
        else:
            start = jnp.maximum(state.start, MIN_VIOLATION)
            gain = self._gain(start, self.omega.remaining(jnp.zeros_like(tau)))
        required = gain * self.omega(tau) * parts**self.rho
        ell = input_gradient(control, gradient, moving)
        return Demand(
            ell=ell[None],
            rate=jnp.sum(gradient * drift, axis=-1)[None],
            explicit_rate=jnp.zeros_like(total)[None],
            value=total[None],
            bound=self.bound(state, tau)[None],
            limit=self.limit(state, tau)[None],
            contribution=parts[None],
            value_nan=jnp.isnan(parts)[None],
            shares=lambda norm_sq: self.allocation(
                required, norm_sq[0], lambda: margins.dependence(z, condition, self.buffer)
            )[None],
        )

    def on_forced_step(
        self, state: PrivateState, tau: Scalar, value: RowValues, above: RowFlags
    ) -> PrivateState:
        if not self.reanchored:
            return state
        return state._replace(
            anchor=jnp.where(above[0], value[0], state.anchor),
            since=jnp.where(above[0], tau, state.since),
        )
