"""What a generation leaves behind: a summary of every accepted point, and its trace at the points of the grid."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Integer

from .guidance import GuidanceReport
from .identity import fingerprint

BLAMED = (
    0.5  # of the largest part of a value: whose part is as large is named where a step is forced
)


class Trace(NamedTuple):
    """The generation at every grid point, tau = 1 included."""

    tau: Float[Array, " points"]
    value: Float[Array, "points rows"]  # V or q of each requirement
    bound: Float[Array, "points rows"]  # what the theorem promises of it
    limit: Float[Array, "points rows"]  # what a discrete step may reach
    able: Bool[Array, "points rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, "points agents"]  # this agent had no input that meets its rows
    effort: Float[Array, "points agents"]  # |u_i|
    length: Float[Array, "points rows agents"]  # |ell| where the agent must act, else infinite
    active: Bool[Array, "points rows agents"]  # the row decides the agent's input
    sine: Float[Array, "points agents"]  # least sine between opposed rows that must be met, else 1


Kept = tuple[Any, ...]
"""What a trace keeps of a `GuidanceReport`: its fields from `value` to `sine`."""


def kept(report: GuidanceReport) -> Kept:
    """The part of a report that a trace holds."""
    return report[: len(Trace._fields) - 1]


class Work(NamedTuple):
    """What the generation took."""

    evaluations: Int[Array, ""]  # of the guided field at the points that steps reached
    refused: Int[Array, ""]  # steps that landed above a limit and were halved
    forced: Int[Array, ""]  # steps that were taken although they landed above a limit


class NotANumber(NamedTuple):
    """The tau of the first accepted point at which something was not a number; infinite if there was none."""

    drift: Float[Array, " agents"]  # the field; not finite
    value: Float[Array, "rows agents"]  # V_j or q
    gradient: Float[Array, "rows agents"]
    input: Float[Array, " agents"]


class Summary(NamedTuple):
    """Every accepted point of one generation in a few numbers, those between the grid's points included.

    What is said of rows and inputs leaves out tau = 1, which no input follows, and agents that are absent.
    """

    requirements: Integer[
        Array, " requirements"
    ]  # their `requirement_numbers`; none of a trajectory made elsewhere
    condition: Integer[Array, " leaves"]  # its `fingerprint`
    z0: Float[Array, "agents dim"]
    z: Float[Array, "agents dim"]  # at the last accepted point
    first_tau: Float[Array, ""]
    last_tau: Float[Array, ""]
    ordered: Bool[Array, ""]  # the grid increases, and tau fell from no accepted point to the next
    points: Int[Array, ""]  # accepted points, z(0) included
    largest_step: Float[Array, ""]  # greatest distance in z that an agent went from one to the next
    first_value: Float[Array, " rows"]
    first_limit: Float[Array, " rows"]
    value: Float[Array, " rows"]  # at the last accepted point
    limit: Float[Array, " rows"]  # there
    excess: Float[Array, " rows"]  # greatest value - limit
    active: Int[Array, " rows"]  # points at which the row decided some agent's input
    length: Float[
        Array, " rows"
    ]  # smallest |ell| of an agent that had to act; infinite if none had
    sine: Float[Array, ""]  # least sine between opposed rows of one agent; 1 if there were none
    effort: Float[Array, " agents"]  # largest |u_i|
    stuck: Int[Array, "rows agents"]  # points at which the condition of a feasible row failed
    infeasible: Int[Array, " agents"]  # points at which no input met all rows
    forced: Int[
        Array, "rows agents"
    ]  # forced steps that left the row above its limit, by whose it was
    kinks: Int[Array, " rows"]  # points at which the requirement had no gradient
    nan: NotANumber
    work: Work

    @property
    def held(self) -> Any:
        """Whether rows were feasible, the theorems' conditions held, and no value was above its limit; one for each sample."""
        # Methods of the arrays themselves: thousands of records are made of numpy's, in Python.
        met = (self.excess <= 0).all(axis=-1) & (self.work.forced == 0) & self.ordered
        able = (self.stuck == 0).all(axis=(-2, -1)) & (self.kinks == 0).all(axis=-1)
        return met & able & (self.infeasible == 0).all(axis=-1) & ~self.not_a_number

    @property
    def not_a_number(self) -> Any:
        """Whether something was not a number; one for each sample."""
        drift, value, gradient, given = self.nan
        inside = (value < jnp.inf).any(axis=(-2, -1)) | (gradient < jnp.inf).any(axis=(-2, -1))
        return inside | (drift < jnp.inf).any(axis=-1) | (given < jnp.inf).any(axis=-1)


def empty_summary(
    grid: Float[Array, " points"],
    z0: Float[Array, "agents dim"],
    condition: Any,
    rows: int,
) -> Summary:
    """The summary before the first point."""
    dtype, agents, tau = z0.dtype, len(z0), grid[0]
    count = jnp.zeros((), jnp.int32)
    row, pair = jnp.zeros(rows, dtype), jnp.zeros((rows, agents), dtype)
    never, nothing = jnp.full(agents, jnp.inf, dtype), jnp.zeros((rows, agents), jnp.int32)
    return Summary(
        requirements=jnp.zeros(0, jnp.uint32),
        condition=fingerprint(condition, dtype), z0=z0, z=z0, first_tau=tau, last_tau=tau,
        ordered=jnp.all(jnp.diff(grid) > 0), points=count,
        largest_step=jnp.zeros((), dtype), first_value=row, first_limit=row, value=row, limit=row,
        excess=row - jnp.inf, active=jnp.zeros(rows, jnp.int32), length=row + jnp.inf,
        sine=jnp.ones((), dtype), effort=jnp.zeros(agents, dtype), stuck=nothing,
        infeasible=jnp.zeros(agents, jnp.int32), forced=nothing, kinks=jnp.zeros(rows, jnp.int32),
        nan=NotANumber(never, pair + jnp.inf, pair + jnp.inf, never),
        work=Work(count, count, count),
    )  # fmt: skip


class Point(NamedTuple):
    """An evaluated point and what became of it."""

    tau: Float[Array, ""]
    z: Float[Array, "agents dim"]
    report: GuidanceReport
    accepted: Bool[Array, ""]
    refused: Bool[Array, ""]
    over: Bool[Array, " rows"]  # rows above their limits
    forced: Bool[Array, ""]  # accepted although some row is above its limit
    kinks: Bool[Array, " rows"]
    last: Bool[Array, ""]  # no input follows


def add_point(so_far: Summary, point: Point, mask: Bool[Array, " agents"] | None) -> Summary:
    """A summary with one more point; nothing but the work counts where the point was not accepted."""
    report, tau = point.report, point.tau
    new, first = point.accepted, so_far.points == 0
    acts = new & ~point.last
    here = jnp.ones(len(point.z), bool) if mask is None else mask
    at_rows = acts & here[None]
    excess = report.value - report.limit
    # Bounds start from the value itself, which two programs may round apart.
    start = 4 * jnp.finfo(excess.dtype).eps * jnp.abs(report.value)
    excess = jnp.where(first & (excess <= start), jnp.minimum(excess, 0.0), excess)
    excess = jnp.where(jnp.isnan(excess), jnp.inf, excess)
    way = jnp.sqrt(jnp.max(jnp.where(here, jnp.sum((point.z - so_far.z) ** 2, axis=-1), 0.0)))
    part = report.contribution
    blamed = part >= BLAMED * jnp.max(part, axis=-1, keepdims=True)
    blamed &= (point.forced & point.over)[:, None] & here[None]

    def when(flag: Array, value: Array, before: Array) -> Array:
        return jnp.where(flag, value, before)

    def earliest(before: Array, flags: Array, counts: Array) -> Array:
        return jnp.where(flags & counts, jnp.minimum(before, tau), before)

    return Summary(
        requirements=so_far.requirements,
        condition=so_far.condition,
        z0=so_far.z0,
        z=when(new, point.z, so_far.z),
        first_tau=when(new & first, tau, so_far.first_tau),
        last_tau=when(new, tau, so_far.last_tau),
        ordered=so_far.ordered & (~new | first | (tau >= so_far.last_tau)),
        points=so_far.points + new,
        largest_step=when(new & ~first, jnp.maximum(so_far.largest_step, way), so_far.largest_step),
        first_value=when(new & first, report.value, so_far.first_value),
        first_limit=when(new & first, report.limit, so_far.first_limit),
        value=when(new, report.value, so_far.value),
        limit=when(new, report.limit, so_far.limit),
        excess=when(new, jnp.maximum(so_far.excess, excess), so_far.excess),
        active=so_far.active + jnp.any(report.active & at_rows, axis=-1),
        length=jnp.minimum(
            so_far.length, jnp.min(jnp.where(at_rows, report.length, jnp.inf), axis=-1)
        ),
        sine=jnp.minimum(so_far.sine, jnp.min(jnp.where(acts & here, report.sine, 1.0))),
        effort=when(acts & here, jnp.maximum(so_far.effort, report.effort), so_far.effort),
        stuck=so_far.stuck + (~report.able & at_rows),
        infeasible=so_far.infeasible + (report.infeasible & acts & here),
        forced=so_far.forced + blamed,
        kinks=so_far.kinks + (point.kinks & new),
        nan=NotANumber(
            earliest(so_far.nan.drift, report.drift_nan, acts & here),
            earliest(so_far.nan.value, report.value_nan, new & here[None]),
            earliest(so_far.nan.gradient, report.gradient_nan, at_rows),
            earliest(so_far.nan.input, report.input_nan, acts & here),
        ),
        work=Work(
            so_far.work.evaluations + (new | point.refused),
            so_far.work.refused + point.refused,
            so_far.work.forced + point.forced,
        ),
    )
