"""Private requirements (PE guidance): each agent owns a violation that its neighbours also affect."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .allocation import AbstractAllocation, Pooled
from .requirement import AbstractRequirement, Demand, input_gradient
from .schedule import AbstractSchedule, LinearSchedule

MIN_REMAINING = 0.01  # floor of the remaining integral of omega, where re-anchoring divides by it
MIN_VIOLATION = 1e-30  # floor of V(0) in c (paper, Task 2)

Margins = Callable[[Float[Array, "agents dim"], Any], Float[Array, "agents requirements"]]
Violation = Callable[[Float[Array, "agents dim"], Any], Float[Array, " agents"]]


def hinge_violation(margins: Margins, buffer: float) -> Violation:
    """V_i = sum_k max(buffer - h_ik, 0)^2 / 2 from margins h_ik (`>= 0`: satisfied).

    `V <= buffer^2 / 2` implies every h_ik >= 0, so the buffer pays for discretisation.

    Source: paper, Task 2.
    """

    def violation(z: Float[Array, "agents dim"], condition: Any) -> Float[Array, " agents"]:
        return jnp.sum(jnp.maximum(buffer - margins(z, condition), 0.0) ** 2, axis=-1) / 2

    return violation


@runtime_checkable
class Differentiated(Protocol):
    """A violation that has a quicker way to its gradient than automatic differentiation."""

    def and_gradient(
        self, z: Float[Array, "agents dim"], condition: Any
    ) -> tuple[Float[Array, " agents"], Float[Array, "agents dim"]]:
        """V_i, and the gradient of their sum."""


def _and_gradient(
    violation: Violation, z: Float[Array, "agents dim"], condition: Any
) -> tuple[Float[Array, " agents"], Float[Array, "agents dim"]]:
    if isinstance(violation, Differentiated):
        return violation.and_gradient(z, condition)

    def total(
        z: Float[Array, "agents dim"],
    ) -> tuple[Float[Array, ""], Float[Array, " agents"]]:
        parts = violation(z, condition)
        return jnp.sum(parts), parts

    gradient, parts = jax.grad(total, has_aux=True)(z)
    return parts, gradient


class PrivateState(NamedTuple):
    """Where the bound on V starts from."""

    start: Float[Array, ""]  # V(0)
    anchor: Float[Array, ""]  # V at `since`
    since: Float[Array, ""]  # 0, or when a step last landed above its limit


class PrivateRequirement(AbstractRequirement):
    """Drives V = sum_i V_i to zero by tau = 1 (paper, thm:private_finite_time).

    Each owner calls for a decrease of c omega V_j^rho, shared out by `allocation`. The paper fixes c from
    V(0). With `reanchored`, c is taken afresh from the present,
    c(tau) = kappa V^(1 - rho) / ((1 - rho) int_tau^1 omega), so that after any disturbance
    V(tau) <= V(s) (int_tau^1 omega / int_s^1 omega)^(kappa / (1 - rho)): convergence in prescribed time.
    With `separate`, each owner takes its c_j from its own V_j: the demands, linear in V_j then, add up to that of V
    exactly, and nobody has to know the team's V. (With one c for all, sum_j V_j^rho >= V^rho: the demand grows with
    the team, up to n^(1 - rho) times, and so do the steps' errors.)
    `floor` is a value of V at which every requirement holds already, buffer^2 / 2 for `hinge_violation`; no
    step is refused for a V below it.
    """

    violation: Violation
    allocation: AbstractAllocation = Pooled()
    reanchored: bool = eqx.field(static=True, default=True)
    separate: bool = eqx.field(static=True, default=False)
    rho: float = eqx.field(static=True, default=0.75)
    kappa: float = eqx.field(static=True, default=1.15)
    omega: AbstractSchedule = LinearSchedule()
    floor: float = eqx.field(static=True, default=0.0)
    name: str = eqx.field(static=True, default="private")

    def __check_init__(self) -> None:
        if not 0 < self.rho < 1:
            raise ValueError(
                f"`rho` must be in (0, 1) (finite-horizon theorem for PE guidance); got {self.rho}."
            )
        if not self.kappa >= 1:
            raise ValueError(
                "`kappa` must be at least 1, else c is too small for V to reach zero by tau = 1 "
                f"(finite-horizon theorem for PE guidance); got {self.kappa}."
            )
        if self.separate and not self.reanchored:
            raise ValueError(
                "`separate` needs `reanchored`: a V_j that is zero at first may grow, and its c_j with it."
            )

    @property
    def names(self) -> tuple[str, ...]:
        return (self.name,)

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> PrivateState:
        """V(0), from which c and the bound start."""
        total = jnp.sum(self.violation(z0, condition))
        return PrivateState(total, total, jnp.zeros_like(total))

    def _gain(
        self, total: Float[Array, "*agents"], remaining: Float[Array, ""]
    ) -> Float[Array, "*agents"]:
        return self.kappa / (1 - self.rho) * total ** (1 - self.rho) / remaining

    def bound(self, state: PrivateState, tau: Float[Array, ""]) -> Float[Array, ""]:
        """What V(tau) stays below: the theorem's bound, or that of the re-anchored gain."""
        return self._decayed(state, tau, self.kappa)

    def _decayed(
        self, state: PrivateState, tau: Float[Array, ""], kappa: float
    ) -> Float[Array, ""]:
        whole, rest = self.omega.remaining(state.since), self.omega.remaining(tau)
        left = rest / jnp.maximum(whole, MIN_REMAINING)
        if self.reanchored:
            return state.anchor * left ** (kappa / (1 - self.rho))
        # Of V(0)^(1 - rho), linear in the integral of omega.
        return state.anchor * jnp.maximum(1 - kappa * (1 - left), 0.0) ** (1 / (1 - self.rho))

    def values(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, " rows"]:
        return jnp.sum(self.violation(z, condition))[None]

    def demand(
        self,
        state: PrivateState,
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        control: Float[Array, "agents dim inputs"] | None,
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> Demand:
        parts, gradient = _and_gradient(self.violation, z, condition)
        total = jnp.sum(parts)
        if self.reanchored:
            whole = parts if self.separate else total
            gain = self._gain(whole, jnp.maximum(self.omega.remaining(tau), MIN_REMAINING))
        else:
            start = jnp.maximum(state.start, MIN_VIOLATION)
            gain = self._gain(start, self.omega.remaining(jnp.zeros_like(tau)))
        owed = gain * self.omega(tau) * parts**self.rho
        ell = input_gradient(control, gradient, moving)
        rate = jnp.sum(gradient * drift, axis=-1)
        # kappa = 1 just reaches zero at tau = 1: what kappa gives beyond that may be spent on discretisation.
        limit = jnp.maximum(self._decayed(state, tau, 1.0), self.floor)
        bound = self.bound(state, tau)
        return Demand(ell[None], rate[None], total[None], bound[None], limit[None], owed)

    def shares(
        self,
        demand: Demand,
        reach: Float[Array, "rows agents"],
        z: Float[Array, "agents dim"],
        condition: Any,
        moving: Bool[Array, " agents"] | None = None,
    ) -> Float[Array, "rows agents"]:
        return self.allocation(demand.owed, reach[0], z, condition)[None]

    def landed(
        self,
        state: PrivateState,
        tau: Float[Array, ""],
        value: Float[Array, " rows"],
        above: Bool[Array, " rows"],
    ) -> PrivateState:
        if not self.reanchored:
            return state
        return PrivateState(
            state.start,
            jnp.where(above[0], value[0], state.anchor),
            jnp.where(above[0], tau, state.since),
        )
