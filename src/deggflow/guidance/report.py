"""What guidance reports of one evaluation."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


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
    slope: Float[Array, " rows"]  # d value / d tau under drift and input
    contribution: Float[Array, "rows agents"]  # how much of the value is whose; of any unit
    drift_nan: Bool[Array, " agents"]  # the field is not finite there
    value_nan: Bool[Array, "rows agents"]  # the requirement is not a number there
    gradient_nan: Bool[Array, "rows agents"]  # its gradient is not
    input_nan: Bool[Array, " agents"]  # the agent's input is not


def report_without_rows(
    drift: Float[Array, "agents dim"], u: Float[Array, "agents dim"]
) -> GuidanceReport:
    """What guidance without rows reports: efforts, and what is not a number."""
    agents = len(drift)
    row, rows = jnp.zeros(0, drift.dtype), jnp.zeros((0, agents), drift.dtype)
    none, nobody = jnp.zeros((0, agents), bool), jnp.zeros(agents, bool)
    return GuidanceReport(
        value=row, bound=row, limit=row, able=none, infeasible=nobody,
        effort=jnp.linalg.norm(u, axis=-1), length=rows, active=none,
        sine=jnp.ones(agents, drift.dtype), slope=row, contribution=rows,
        drift_nan=not_finite(drift), value_nan=none, gradient_nan=none,
        input_nan=jnp.any(jnp.isnan(u), axis=-1),
    )  # fmt: skip


def not_finite(drift: Float[Array, "agents dim"]) -> Bool[Array, " agents"]:
    """At which agents a field has no finite value."""
    return ~jnp.all(jnp.isfinite(drift), axis=-1)
