"""What guidance reports of one evaluation."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class GuidanceReport(NamedTuple):
    """What happened in one evaluation of the guidance, for one sample.

    Attributes:
        value: V or q of each requirement.
        bound: What the theorem promises of the value.
        limit: The most that a discrete step may reach.
        row_feasible: Whether the theorem's condition for a feasible row holds.
        qp_infeasible: Whether no input of the agent meets all of its rows.
        input_norm: |u_i|.
        ell_norm: |ell| where the agent must act (b > 0), else infinite.
        active: Whether the row decides the input, that is, the input meets it with equality.
        opposed_sine: Least sine between two opposed rows that the agent must meet; 1 without such rows.
        slope: d value / d tau under drift and input.
        contribution: How much each agent contributes to the value, in any unit.
        drift_nan: Whether the field is not finite.
        value_nan: Whether the requirement is not a number.
        gradient_nan: Whether its gradient is not a number.
        input_nan: Whether the agent's input is not a number.
    """

    value: Float[Array, " rows"]
    bound: Float[Array, " rows"]
    limit: Float[Array, " rows"]
    row_feasible: Bool[Array, "rows agents"]
    qp_infeasible: Bool[Array, " agents"]
    input_norm: Float[Array, " agents"]
    ell_norm: Float[Array, "rows agents"]
    active: Bool[Array, "rows agents"]
    opposed_sine: Float[Array, " agents"]
    slope: Float[Array, " rows"]
    contribution: Float[Array, "rows agents"]
    drift_nan: Bool[Array, " agents"]
    value_nan: Bool[Array, "rows agents"]
    gradient_nan: Bool[Array, "rows agents"]
    input_nan: Bool[Array, " agents"]


def report_without_rows(
    drift: Float[Array, "agents dim"], u: Float[Array, "agents dim"]
) -> GuidanceReport:
    """What guidance without rows reports: the inputs' norms, and what is not a number."""
    agents = len(drift)
    row, rows = jnp.zeros(0, drift.dtype), jnp.zeros((0, agents), drift.dtype)
    none, nobody = jnp.zeros((0, agents), bool), jnp.zeros(agents, bool)
    return GuidanceReport(
        value=row, bound=row, limit=row, row_feasible=none, qp_infeasible=nobody,
        input_norm=jnp.linalg.norm(u, axis=-1), ell_norm=rows, active=none,
        opposed_sine=jnp.ones(agents, drift.dtype), slope=row, contribution=rows,
        drift_nan=not_finite(drift), value_nan=none, gradient_nan=none,
        input_nan=jnp.any(jnp.isnan(u), axis=-1),
    )  # fmt: skip


def not_finite(drift: Float[Array, "agents dim"]) -> Bool[Array, " agents"]:
    """At which agents a field has no finite value."""
    return ~jnp.all(jnp.isfinite(drift), axis=-1)
