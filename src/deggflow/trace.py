"""What a generation leaves behind: a summary of every accepted point, and its trace at the points of the grid."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Integer

from .guidance import GuidanceReport
from .identity import fingerprint
from .shapes import Scalar

BLAMED = 0.5
"""Of the largest contribution to a value: agents that contribute at least as much are named where a step is forced."""
ROUNDING = 64  # times the precision: what a value's own sums may be off


def rounding(
    one: Float[Array, "*samples rows"], other: Float[Array, "*samples rows"]
) -> Float[Array, "*samples rows"]:
    """What rounding may add to the difference of two values."""
    return ROUNDING * jnp.finfo(one.dtype).eps * (jnp.abs(one) + jnp.abs(other))


class Trace(NamedTuple):
    """The generation at every grid point, tau = 1 included.

    Attributes:
        tau: Generative time.
        value: V or q of each requirement.
        bound: What the theorem promises of the value.
        limit: The most that a discrete step may reach.
        row_feasible: Whether the theorem's condition for a feasible row holds.
        qp_infeasible: Whether no input of the agent meets all of its rows.
        input_norm: |u_i|.
        ell_norm: |ell| where the agent must act, else infinite.
        active: Whether the row decides the agent's input.
        opposed_sine: Least sine between two opposed rows that the agent must meet; 1 without such rows.
    """

    tau: Float[Array, " points"]
    value: Float[Array, "points rows"]
    bound: Float[Array, "points rows"]
    limit: Float[Array, "points rows"]
    row_feasible: Bool[Array, "points rows agents"]
    qp_infeasible: Bool[Array, "points agents"]
    input_norm: Float[Array, "points agents"]
    ell_norm: Float[Array, "points rows agents"]
    active: Bool[Array, "points rows agents"]
    opposed_sine: Float[Array, "points agents"]


TracedReport = tuple[Any, ...]
"""The fields of a `GuidanceReport` that a trace holds, from `value` to `opposed_sine`."""


def traced(report: GuidanceReport) -> TracedReport:
    """The part of a report that a trace holds."""
    return report[: len(Trace._fields) - 1]


def empty_trace(points: int, rows: int, z0: Float[Array, "agents dim"]) -> TracedReport:
    """What is traced, before the first point."""
    row = jnp.zeros((points, rows), z0.dtype)
    agent = jnp.zeros((points, len(z0)), z0.dtype)
    pair = jnp.zeros((points, rows, len(z0)), z0.dtype)
    no, nobody = pair.astype(bool), agent.astype(bool)
    _, *fields = Trace(
        tau=jnp.zeros(points, z0.dtype), value=row, bound=row, limit=row, row_feasible=no,
        qp_infeasible=nobody, input_norm=agent, ell_norm=pair, active=no, opposed_sine=agent,
    )  # fmt: skip
    return tuple(fields)


class Work(NamedTuple):
    """What the generation took.

    Attributes:
        evaluations: Of the guidance, at the points that steps reached.
        field_evaluations: Of the nominal field, stages of the scheme included; known at the end.
        refused_steps: Steps that ended above a limit and were halved.
        forced_steps: Steps that were taken although they ended above a limit.
    """

    evaluations: Int[Array, ""]
    field_evaluations: Int[Array, ""]
    refused_steps: Int[Array, ""]
    forced_steps: Int[Array, ""]


class NotANumber(NamedTuple):
    """The tau of the first accepted point at which something was not a number; infinite if there was none.

    Attributes:
        drift: The field, where it is not finite.
        value: V_j or q.
        gradient: Of the value.
        input: u_i.
    """

    drift: Float[Array, " agents"]
    value: Float[Array, "rows agents"]
    gradient: Float[Array, "rows agents"]
    input: Float[Array, " agents"]


class Summary(NamedTuple):
    """Every accepted point of one generation in a few numbers, those between the grid's points included.

    Whatever concerns rows and inputs leaves out tau = 1, which no input follows, and agents that are absent.

    Attributes:
        requirements: Their `requirement_numbers`; none of a trajectory made elsewhere.
        condition: Its `fingerprint`.
        z0: Initial sample.
        z: State at the last accepted point.
        first_tau: tau of the first accepted point.
        last_tau: tau of the last accepted point.
        ordered: Whether the grid increases, and tau fell from no accepted point to the next.
        points: Number of accepted points, z(0) included.
        largest_step: Greatest distance in z that an agent moved from one point to the next.
        first_value: V or q at the first point.
        first_limit: Limit there.
        value: V or q at the last accepted point.
        limit: Limit there.
        excess: Greatest value - limit.
        certain_excess: Greatest value - limit, less what rounding may account for.
        active_points: Points at which the row decided some agent's input.
        smallest_ell_norm: Smallest |ell| of an agent that had to act; infinite if none had to.
        least_opposed_sine: Least sine between two opposed rows of one agent; 1 if there were none.
        largest_input_norm: Largest |u_i|.
        infeasible_points: Points at which the theorem's condition for a feasible row failed.
        qp_infeasible_points: Points at which no input met all rows of the agent.
        forced_steps: Forced steps that left the row above its limit, for each agent to which that is ascribed.
        kink_points: Points at which the requirement had no gradient.
        nan: Where something was not a number first.
        work: What the generation took.
    """

    requirements: Integer[Array, " requirements"]
    condition: Integer[Array, " leaves"]
    z0: Float[Array, "agents dim"]
    z: Float[Array, "agents dim"]
    first_tau: Float[Array, ""]
    last_tau: Float[Array, ""]
    ordered: Bool[Array, ""]
    points: Int[Array, ""]
    largest_step: Float[Array, ""]
    first_value: Float[Array, " rows"]
    first_limit: Float[Array, " rows"]
    value: Float[Array, " rows"]
    limit: Float[Array, " rows"]
    excess: Float[Array, " rows"]
    certain_excess: Float[Array, " rows"]
    active_points: Int[Array, " rows"]
    smallest_ell_norm: Float[Array, " rows"]
    least_opposed_sine: Float[Array, ""]
    largest_input_norm: Float[Array, " agents"]
    infeasible_points: Int[Array, "rows agents"]
    qp_infeasible_points: Int[Array, " agents"]
    forced_steps: Int[Array, "rows agents"]
    kink_points: Int[Array, " rows"]
    nan: NotANumber
    work: Work

    @property
    def hypotheses_hold(self) -> Any:
        """Whether the theorems' hypotheses hold at every point and no value is above its limit; one for each sample."""
        # Methods of the arrays themselves: thousands of records are made of numpy's, in Python.
        below = (self.excess <= 0).all(axis=-1) & (self.work.forced_steps == 0)
        feasible = (self.infeasible_points == 0).all(axis=(-2, -1))
        feasible &= (self.qp_infeasible_points == 0).all(axis=-1)
        smooth = (self.kink_points == 0).all(axis=-1)
        return below & feasible & smooth & self.ordered & ~self.not_a_number

    @property
    def not_a_number(self) -> Any:
        """Whether something was not a number; one for each sample."""
        drift, value, gradient, control = self.nan
        of_rows = (value < jnp.inf).any(axis=(-2, -1)) | (gradient < jnp.inf).any(axis=(-2, -1))
        return of_rows | (drift < jnp.inf).any(axis=-1) | (control < jnp.inf).any(axis=-1)


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
        excess=row - jnp.inf, certain_excess=row - jnp.inf, active_points=jnp.zeros(rows, jnp.int32),
        smallest_ell_norm=row + jnp.inf, least_opposed_sine=jnp.ones((), dtype),
        largest_input_norm=jnp.zeros(agents, dtype), infeasible_points=nothing,
        qp_infeasible_points=jnp.zeros(agents, jnp.int32), forced_steps=nothing,
        kink_points=jnp.zeros(rows, jnp.int32),
        nan=NotANumber(never, pair + jnp.inf, pair + jnp.inf, never),
        work=Work(count, count, count, count),
    )  # fmt: skip


class Point(NamedTuple):
    """An evaluated point and what became of it.

    Attributes:
        tau: Generative time.
        z: State.
        report: Of the guidance there.
        accepted: Whether the step that led there was taken.
        refused: Whether it was halved.
        over: Which rows are above their limits.
        forced: Whether the step was taken although some row is above its limit.
        kinks: Which requirements have no gradient there.
        last: Whether no input follows.
    """

    tau: Float[Array, ""]
    z: Float[Array, "agents dim"]
    report: GuidanceReport
    accepted: Bool[Array, ""]
    refused: Bool[Array, ""]
    over: Bool[Array, " rows"]
    forced: Bool[Array, ""]
    kinks: Bool[Array, " rows"]
    last: Bool[Array, ""]


def add_point(so_far: Summary, point: Point, mask: Bool[Array, " agents"] | None) -> Summary:
    """A summary with one more point; nothing but the work counts where the point was not accepted."""
    report, tau = point.report, point.tau
    new, first = point.accepted, so_far.points == 0
    acts = new & ~point.last
    here = jnp.ones(len(point.z), bool) if mask is None else mask
    at_rows = acts & here[None]
    excess = _excess(report.value, report.limit, first)
    certain = excess - rounding(report.value, report.limit)
    certain = jnp.where(jnp.isnan(certain), excess, certain)
    distance = jnp.sqrt(jnp.max(jnp.where(here, jnp.sum((point.z - so_far.z) ** 2, axis=-1), 0.0)))
    blamed = _blamed(point) & here[None]

    def when(flag: Array, value: Array, before: Array) -> Array:
        return jnp.where(flag, value, before)

    return so_far._replace(
        z=when(new, point.z, so_far.z),
        first_tau=when(new & first, tau, so_far.first_tau),
        last_tau=when(new, tau, so_far.last_tau),
        ordered=so_far.ordered & (~new | first | (tau >= so_far.last_tau)),
        points=so_far.points + new,
        largest_step=when(
            new & ~first, jnp.maximum(so_far.largest_step, distance), so_far.largest_step
        ),
        first_value=when(new & first, report.value, so_far.first_value),
        first_limit=when(new & first, report.limit, so_far.first_limit),
        value=when(new, report.value, so_far.value),
        limit=when(new, report.limit, so_far.limit),
        excess=when(new, jnp.maximum(so_far.excess, excess), so_far.excess),
        certain_excess=when(
            new, jnp.maximum(so_far.certain_excess, certain), so_far.certain_excess
        ),
        **_rows_and_inputs(so_far, report, acts & here, at_rows),
        forced_steps=so_far.forced_steps + blamed,
        kink_points=so_far.kink_points + (point.kinks & new),
        nan=_not_a_number(so_far.nan, report, tau, new & here, acts & here),
        work=Work(
            so_far.work.evaluations + (new | point.refused),
            so_far.work.field_evaluations,
            so_far.work.refused_steps + point.refused,
            so_far.work.forced_steps + point.forced,
        ),
    )


def _blamed(point: Point) -> Bool[Array, "rows agents"]:
    """Whose contributions a forced step is put down to."""
    part = point.report.contribution
    large = part >= BLAMED * jnp.max(part, axis=-1, keepdims=True)
    return large & (point.forced & point.over)[:, None]


def _rows_and_inputs(
    so_far: Summary,
    report: GuidanceReport,
    acting: Bool[Array, " agents"],
    at_rows: Bool[Array, "1 agents"],
) -> dict[str, Array]:
    """What is known of rows and inputs with those of agents that act."""
    return {
        "active_points": so_far.active_points + jnp.any(report.active & at_rows, axis=-1),
        "smallest_ell_norm": jnp.minimum(
            so_far.smallest_ell_norm,
            jnp.min(jnp.where(at_rows, report.ell_norm, jnp.inf), axis=-1),
        ),
        "least_opposed_sine": jnp.minimum(
            so_far.least_opposed_sine, jnp.min(jnp.where(acting, report.opposed_sine, 1.0))
        ),
        "largest_input_norm": jnp.where(
            acting,
            jnp.maximum(so_far.largest_input_norm, report.input_norm),
            so_far.largest_input_norm,
        ),
        "infeasible_points": so_far.infeasible_points + (~report.row_feasible & at_rows),
        "qp_infeasible_points": so_far.qp_infeasible_points + (report.qp_infeasible & acting),
    }


def _not_a_number(
    so_far: NotANumber,
    report: GuidanceReport,
    tau: Scalar,
    there: Bool[Array, " agents"],
    acting: Bool[Array, " agents"],
) -> NotANumber:
    """With the earliest tau of what is not a number at agents that are there, or act."""

    def earliest(before: Array, flags: Array, counts: Array) -> Array:
        return jnp.where(flags & counts, jnp.minimum(before, tau), before)

    return NotANumber(
        earliest(so_far.drift, report.drift_nan, acting),
        earliest(so_far.value, report.value_nan, there[None]),
        earliest(so_far.gradient, report.gradient_nan, acting[None]),
        earliest(so_far.input, report.input_nan, acting),
    )


def _excess(
    value: Float[Array, "*samples rows"],
    limit: Float[Array, "*samples rows"],
    first: Bool[Array, ""] | bool,
) -> Float[Array, "*samples rows"]:
    """Value - limit at one point; infinite where that is not a number."""
    excess = value - limit
    # Bounds start from the value itself, which two programs may round apart.
    start = 4 * jnp.finfo(excess.dtype).eps * jnp.abs(value)
    excess = jnp.where(first & (excess <= start), jnp.minimum(excess, 0.0), excess)
    return jnp.where(jnp.isnan(excess), jnp.inf, excess)


def as_accepted(
    summary: Summary, trace: TracedReport | None
) -> tuple[Summary, TracedReport | None]:
    """Values as steps were accepted: after z(0), at most their limits where no step of a sample was forced.

    A compiler may evaluate a value twice, for the comparison that accepts the step and for what is written down, and
    round the two apart. A value that is above its limit by more than that stays, with all others of its row: a step that
    should have been counted as forced shows.

    Args:
        summary: Of a sample whose steps were guarded, or of a batch.
        trace: Of the same; None if it was not kept.
    """
    met = (summary.work.forced_steps == 0)[..., None] & (summary.certain_excess <= 0)
    first = _excess(summary.first_value, summary.first_limit, True)
    after = met & (summary.points > 1)[..., None]
    summary = summary._replace(
        value=jnp.where(after, jnp.minimum(summary.value, summary.limit), summary.value),
        excess=jnp.where(met, jnp.maximum(first, jnp.minimum(summary.excess, 0.0)), summary.excess),
    )
    if trace is None:
        return summary, None
    value, bound, limit, *others = trace
    later, most = value[..., 1:, :], limit[..., 1:, :]
    later = jnp.where(met[..., None, :], jnp.minimum(later, most), later)
    value = jnp.concatenate([value[..., :1, :], later], axis=-2)
    return summary, (value, bound, limit, *others)
