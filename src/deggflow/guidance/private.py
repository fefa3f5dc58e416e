"""Private requirements (PE guidance): each agent owns a violation that its neighbours also affect."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .allocation import AbstractAllocation, Pooled
from .requirement import AbstractRequirement, Rows, input_gradient
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


class PrivateRequirement(AbstractRequirement):
    """Drives V = sum_i V_i to zero by tau = 1 (paper, thm:private_finite_time).

    Each owner calls for a decrease of c omega V_j^rho, shared out by `allocation`. The paper fixes c from
    V(0). With `reanchored`, c is taken afresh from the present,
    c(tau) = kappa V^(1 - rho) / ((1 - rho) int_tau^1 omega), so that after any disturbance
    V(tau) <= V(s) (int_tau^1 omega / int_s^1 omega)^(kappa / (1 - rho)): convergence in prescribed time.
    """

    violation: Violation
    allocation: AbstractAllocation = Pooled()
    reanchored: bool = eqx.field(static=True, default=True)
    rho: float = eqx.field(static=True, default=0.75)
    kappa: float = eqx.field(static=True, default=1.15)
    omega: AbstractSchedule = LinearSchedule()
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

    def init(self, z0: Float[Array, "agents dim"], condition: Any) -> Float[Array, ""]:
        """The constant c, from V(0)."""
        total = jnp.maximum(jnp.sum(self.violation(z0, condition)), MIN_VIOLATION)
        return self._gain(total, self.omega.remaining(jnp.zeros(())))

    def _gain(self, total: Float[Array, ""], remaining: Float[Array, ""]) -> Float[Array, ""]:
        return self.kappa / (1 - self.rho) * total ** (1 - self.rho) / remaining

    def rows(
        self,
        state: Float[Array, ""],
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        drift: Float[Array, "agents dim"],
        control: Float[Array, "agents dim inputs"] | None,
        condition: Any,
    ) -> Rows:
        def total_and_parts(
            state: Float[Array, "agents dim"],
        ) -> tuple[Float[Array, ""], Float[Array, " agents"]]:
            parts = self.violation(state, condition)
            return jnp.sum(parts), parts

        (total, parts), gradient = jax.value_and_grad(total_and_parts, has_aux=True)(z)
        if self.reanchored:
            remaining = jnp.maximum(self.omega.remaining(tau), MIN_REMAINING)
            gain = self._gain(total, remaining)
        else:
            gain = state
        demand = gain * self.omega(tau) * parts**self.rho
        ell = input_gradient(control, gradient)
        zeta = self.allocation(demand, jnp.sum(ell**2, axis=-1), z, condition)
        return Rows(ell, jnp.sum(gradient * drift, axis=-1) + zeta, total)
