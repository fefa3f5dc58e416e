"""What is said of a finished sample: whether every requirement holds, by how much, and if not, why.

Two things are said apart. The verdict is made in float64 on the finished sample and trusts nothing that happened on
the way. The record says what did: every requirement's value against its limit, and whether the conditions of the
theorems held in every step.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .generation import Generation
from .guidance import AbstractRequirement, DecoupledGuidance, GuidanceReport
from .guidance.decoupled import least_sine
from .trace import Summary, Trace, Work, summarise

ROUNDING = 1e-5  # of |ell| |dz/dtau| and |b|: rows that a given trajectory meets as closely are met
TINY = 1e-300

Margins = Callable[[Float[Array, "agents dim"], Any], Float[Array, "agents requirements"]]


class Trajectory(NamedTuple):
    """A generation made elsewhere: states at increasing values of tau."""

    tau: Float[np.ndarray, " points"]
    z: Float[np.ndarray, "points agents dim"]


@dataclass(frozen=True)
class RequirementRecord:
    """One requirement along a generation, V or q by its name."""

    name: str
    value: float  # at the last point
    limit: float  # what it may be there
    excess: float  # greatest value - limit of all points; positive where it was above
    active: int  # points at which it decided some agent's input
    smallest_ell: float | None  # least |ell| of an agent that had to act; None if none had to


@dataclass(frozen=True)
class TraceRecord:
    """Every requirement's value at every point, against what the theorem promises."""

    tau: tuple[float, ...]
    value: tuple[tuple[float, ...], ...]  # points x requirements
    bound: tuple[tuple[float, ...], ...]  # promised in continuous time
    limit: tuple[tuple[float, ...], ...]  # what a discrete step may reach


@dataclass(frozen=True)
class GenerationRecord:
    """What happened in a generation, and whether the conditions of the theorems held all along."""

    held: bool  # rows feasible, conditions met, no value above its limit
    broken: str | None  # the first of these that failed: where, and at which agent
    requirements: tuple[RequirementRecord, ...]
    steps: int  # steps taken
    refused: int  # steps that landed above a limit and were halved
    forced: int  # steps taken although they landed above a limit
    least_sine: float | None  # between two opposed rows of one agent; None if none were opposed
    effort: float  # largest |u_i|
    trace: TraceRecord | None = None

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without `trace` where none is kept."""
        out = asdict(self)
        if self.trace is None:
            del out["trace"]
        return out


@dataclass(frozen=True)
class Certificate:
    """The verdict on one sample, made in float64 on the decoded object, and the record of its generation."""

    satisfied: bool
    min_margin: (
        float  # least margin of all requirements, in their units; negative where one is broken
    )
    violation: float  # V at the end; of shared requirements what q exceeds 0 by
    draws: int  # initial samples tried, this one included
    reason: str | None  # which agent and which requirement, if not satisfied
    generation: GenerationRecord | None = None

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file; without `generation` where none is kept."""
        out = asdict(self)
        if self.generation is None:
            del out["generation"]
        else:
            out["generation"] = self.generation.to_json()
        return out

    def table(self) -> str:
        """The certificate as a readable table."""
        draws = f"{self.draws} draw" + "s" * (self.draws != 1)
        head = "satisfied" if self.satisfied else f"NOT satisfied: {self.reason}"
        lines = [f"{head}; least margin {self.min_margin:.3g}, V {self.violation:.3g}, {draws}"]
        return "\n".join(lines + _record_lines(self.generation))


def _record_lines(made: GenerationRecord | None) -> list[str]:
    if made is None:
        return []
    sine = "no rows opposed" if made.least_sine is None else f"least sine {made.least_sine:.2g}"
    held = "held at every point" if made.held else f"did not hold: {made.broken}"
    head = ("requirement", "at the end", "limit", "most above", "active at", "least |ell|")
    rows = [
        (
            each.name,
            f"{each.value:.3g}",
            f"{each.limit:.3g}",
            f"{each.excess:.3g}",
            f"{each.active} points",
            "-" if each.smallest_ell is None else f"{each.smallest_ell:.3g}",
        )
        for each in made.requirements
    ]
    taken = f"{made.steps} steps, {made.refused} refused, {made.forced} forced"
    lines = [f"conditions {held}", f"{taken}; {sine}; largest |u| {made.effort:.3g}"]
    return lines + columns([head, *rows])


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of text as lines with aligned columns, the first to the left, the others to the right."""
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if k else text.ljust(width)
            for k, (text, width) in enumerate(zip(row, wide, strict=True))
        )
        for row in rows
    ]


def record(
    summary: Summary,
    names: Sequence[str],
    agents: Sequence[str] | None = None,
    trace: Trace | None = None,
) -> GenerationRecord:
    """The record of one generation.

    Args:
        summary: Of one sample.
        names: Of the requirements, one per row.
        agents: What to call the agents; "agent 0", ... if None.
        trace: Also kept, if given.
    """
    made = jax.tree.map(np.asarray, summary)
    called = agents or [f"agent {k}" for k in range(made.stuck.shape[-1])]
    held, sine, work = bool(made.held), float(made.sine), made.work
    return GenerationRecord(
        held=held,
        broken=None if held else _broken(made, names, called),
        requirements=tuple(
            RequirementRecord(
                name,
                _number(made.value[k]),
                _number(made.limit[k]),
                _number(made.excess[k]),
                int(made.active[k]),
                _number(made.length[k]) if np.isfinite(made.length[k]) else None,
            )
            for k, name in enumerate(names)
        ),
        steps=int(work.evaluations - work.refused) - 1,
        refused=int(work.refused),
        forced=int(work.above),
        least_sine=sine if sine < 1 else None,
        effort=_number(made.effort.max(initial=0.0)),
        trace=None if trace is None else _trace_record(trace),
    )


def _number(value: Any) -> float:
    """A number that files can hold: what has diverged stands at the end of the scale."""
    number = float(value)
    return 1e12 if math.isnan(number) else min(max(number, -1e12), 1e12)


def _trace_record(trace: Trace) -> TraceRecord:
    def rows(values: Float[Array | np.ndarray, "points rows"]) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(_number(x) for x in row) for row in np.asarray(values, np.float64))

    tau = tuple(np.asarray(trace.tau, np.float64).tolist())
    return TraceRecord(tau, rows(trace.value), rows(trace.bound), rows(trace.limit))


def _broken(made: Any, names: Sequence[str], agents: Sequence[str]) -> str:
    """The condition that failed first, in the order in which one leads to the next."""
    if made.infeasible.any():
        worst = int(made.infeasible.argmax())
        return f"no input of {agents[worst]} met all its rows at {_points(made.infeasible[worst])}"
    if made.stuck.any():
        row, agent = divmod(int(made.stuck.argmax()), made.stuck.shape[1])
        count = _points(made.stuck[row, agent])
        return f"{agents[agent]} did not meet its row of {names[row]} at {count}"
    row, forced = int(made.excess.argmax()), int(made.work.above)
    if made.excess[row] <= 0:
        return f"{forced} steps were forced"
    text = f"{names[row]} was above its limit by {_number(made.excess[row]):.3g}"
    return f"{text}, {forced} steps were forced" if forced else text


def _points(count: Any) -> str:
    return f"{int(count)} point" + "s" * (int(count) != 1)


def certify(
    trajectory: Generation | Trajectory,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    margins: Margins | None = None,
    names: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    draws: int = 1,
    keep_trace: bool = False,
) -> Certificate:
    """Checks a finished generation, ours or one made elsewhere.

    Of a `Generation` the record is what guidance reported in every step. Of a `Trajectory` it is made anew, in
    float64: every requirement's value against its limit at every point, and every agent's row with its own
    velocity (z' - z) / (tau' - tau) in the place of drift and input, which is what explicit Euler steps keep.

    Args:
        trajectory: `generate(...)` of one sample, or states at values of tau.
        requirements: What it has to meet.
        condition: What the requirements are conditioned on.
        margins: The exact verdict on z(1), h_ik >= 0 where satisfied, one row per agent; by default what the
            requirements allow at tau = 1.
        names: Names of the margins, one per column, for the reason.
        agents: What to call the agents; "agent 0", ... if None.
        draws: Number of initial samples tried so far.
        keep_trace: Also keep the trace in the record.

    Raises:
        ValueError: The trajectory's shapes do not fit, tau does not increase from 0 to 1, or the generation was made
            under other requirements.
    """
    guidance = requirements
    if not isinstance(guidance, DecoupledGuidance):
        guidance = DecoupledGuidance(tuple(guidance))
    if isinstance(trajectory, Trajectory):
        _check(trajectory)
    elif trajectory.trace.value.shape != (len(trajectory.trace.tau), len(guidance.names)):
        raise ValueError(
            f"the generation has {trajectory.trace.value.shape[-1]} requirements at each of its points, "
            f"`requirements` are {len(guidance.names)}: {', '.join(guidance.names)}."
        )
    z = trajectory.z if isinstance(trajectory, Generation) else trajectory.z[-1]
    with jax.enable_x64(True):
        exact, given = jax.tree.map(_to_double, (np.asarray(z), condition))
        if isinstance(trajectory, Generation):
            trace, summary = trajectory.trace, summarise(trajectory.trace, trajectory.work)
        else:
            trace, summary = follow(guidance, trajectory, given)
        value = guidance.values(jnp.ones(()), exact, given)
        excess = jnp.maximum(summary.excess, value - summary.limit)
        made = record(
            summary._replace(value=value, excess=excess),
            guidance.names,
            agents,
            trace if keep_trace else None,
        )
        exact_margins = None if margins is None else np.asarray(margins(exact, given), np.float64)
    if exact_margins is None:
        least, reason = _by_values(np.asarray(summary.limit, np.float64) - np.asarray(value), made)
    else:
        least, reason = _by_margins(exact_margins, names, agents)
    violation = _number(sum(max(each.value, 0.0) for each in made.requirements))
    return Certificate(reason is None, least, violation, draws, reason, made)


def _check(trajectory: Trajectory) -> None:
    tau, z = np.asarray(trajectory.tau), np.asarray(trajectory.z)
    if z.ndim != 3 or tau.shape != (len(z),) or len(z) < 2:
        raise ValueError(
            "a trajectory has at least two points, `tau` of shape (points,) and `z` of shape (points, agents, dim); "
            f"got {tau.shape} and {z.shape}."
        )
    if not (np.diff(tau) > 0).all():
        k = int(np.argmin(np.diff(tau) > 0))
        raise ValueError(f"`tau` must increase; got {tau[k]} before {tau[k + 1]} at point {k + 1}.")
    if tau[0] != 0 or tau[-1] != 1:
        raise ValueError(f"`tau` must go from 0 to 1; got {tau[0]} to {tau[-1]}.")


def follow(
    guidance: DecoupledGuidance, trajectory: Trajectory, condition: Any
) -> tuple[Trace, Summary]:
    """Trace and summary of a trajectory made elsewhere, from nothing but its states; call it in float64."""
    given = np.asarray(trajectory.z)
    # Whatever a file made of them: states that are float32 numbers were rounded to such.
    single = np.array_equal(given.astype(np.float32), given, equal_nan=True)
    eps = np.finfo(np.float32 if single else np.float64).eps
    tau, z = (jnp.asarray(np.asarray(leaf), jnp.float64) for leaf in trajectory)
    step = jnp.diff(tau)
    # The last point has no velocity; a standstill asks nothing of it.
    velocity = jnp.concatenate([jnp.diff(z, axis=0) / step[:, None, None], jnp.zeros_like(z[:1])])
    # What rounding of the states can make of a velocity.
    blur = 4 * eps * jnp.max(jnp.abs(z)) / jnp.append(step, jnp.inf)
    state = guidance.init(z[0], condition)
    trace = Trace(tau, *_look(guidance, state, condition, tau, z, velocity, blur))
    none = jnp.asarray(0)
    return trace, summarise(trace, Work(jnp.asarray(len(tau)), none, none))


@eqx.filter_jit
def _look(
    guidance: DecoupledGuidance,
    state: Any,
    condition: Any,
    tau: Float[Array, " points"],
    z: Float[Array, "points agents dim"],
    velocity: Float[Array, "points agents dim"],
    blur: Float[Array, " points"],
) -> GuidanceReport:
    """What guidance would report at every point, of rows in which a velocity stands for drift and input."""

    def one(
        tau: Float[Array, ""],
        z: Float[Array, "agents dim"],
        velocity: Float[Array, "agents dim"],
        blur: Float[Array, ""],
    ) -> GuidanceReport:
        rows = guidance.rows(state, tau, z, velocity, condition)
        length = jnp.linalg.norm(rows.ell, axis=-1)
        speed = jnp.linalg.norm(velocity, axis=-1) + blur / ROUNDING
        room = ROUNDING * (length * speed[None] + jnp.abs(rows.b)) + TINY
        active = (jnp.abs(rows.b) <= room) & (length > 0)
        none = jnp.zeros(len(z))
        return GuidanceReport(
            rows.value, rows.bound, rows.limit, rows.b <= room, none > 0, none,
            jnp.where(active, length, jnp.inf), active, least_sine(rows.ell, active),
        )  # fmt: skip

    return jax.vmap(one)(tau, z, velocity, blur)


def _by_values(
    room: Float[np.ndarray, " rows"], made: GenerationRecord
) -> tuple[float, str | None]:
    """Least room below the limits at tau = 1, and what is above its limit there."""
    room = np.where(np.isnan(room), -np.inf, room)
    worst = int(room.argmin())
    least = _number(room[worst])
    name = made.requirements[worst].name
    return least, None if least >= 0 else f"{name} ends above its limit by {-least:.6g}"


def _by_margins(
    values: Float[np.ndarray, "agents requirements"],
    names: Sequence[str] | None,
    agents: Sequence[str] | None,
) -> tuple[float, str | None]:
    """The least margin, and which agent misses which requirement."""
    least = _number(np.nan_to_num(values, nan=-np.inf).min())
    if least >= 0.0:
        return least, None
    agent, column = divmod(int(np.argmin(values)), values.shape[1])
    name = f"requirement {column}" if names is None else names[column]
    who = f"agent {agent}" if agents is None else agents[agent]
    return least, f"{who} misses {name} by {-least:.6g}"


def _to_double(leaf: Any) -> Any:
    floating = isinstance(leaf, np.ndarray | jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)
    return jnp.asarray(np.asarray(leaf), jnp.float64) if floating else leaf
