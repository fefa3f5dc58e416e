"""Step acceptance: after each step the discrete values are compared with the theorem's bounds.

A step that ends above a limit is halved, from where it began, with the slope that is known there; an accepted one may be
followed by one twice as long. After a few halvings between two grid points it is taken and counted, and the requirement is told. Every sample has its own
clock: a batch goes on while one sample is halved, and the few that are not done when most are go on by themselves.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .guidance import GuidanceReport
from .guided_field import Velocity
from .shapes import Scalar, States
from .solver import RungeKutta
from .trace import (
    Point,
    Summary,
    TracedReport,
    add_point,
    empty_summary,
    empty_trace,
    rounding,
    traced,
)

OnForcedStep = Callable[[Any, Float[Array, ""], Float[Array, " rows"], Bool[Array, " rows"]], Any]

LAST = 16  # the last sixteenth of a batch is finished by itself on an accelerator
# On a CPU the last quarter, sample by sample: a step of a batch of four takes as long as those of ten single samples.
LAST_ON_CPU = 4
GATHERED = 64  # samples; for smaller batches a second loop takes longer to compile than it saves
SHORTEST = 8  # times the precision: a step in tau that is not halved any more
UNSMOOTH = 0.5  # a smooth value rises against its slope by a part that halves with the step; at a kink the part stays


@dataclass(frozen=True)
class StepGuard:
    """How often a step may be halved between two points of the grid.

    Attributes:
        halvings: Largest number of halvings; nonnegative.
        width: How many samples of a batch take their steps at once on a CPU: where one is done, the next takes its place.
            None, and on accelerators: all of them, of which the last are finished by themselves. A small width pays where
            samples are large and some take several times as many evaluations as others.

    With 0 halvings no step is refused; those that end above a limit are counted, and requirements told, all the same.
    """

    halvings: int = 4
    width: int | None = None

    def __post_init__(self) -> None:
        if self.halvings < 0:
            raise ValueError(f"`halvings` must not be negative; got {self.halvings}.")
        if self.width is not None and self.width < 1:
            raise ValueError(f"`width` must be at least 1, or None; got {self.width}.")


class SampleProgress(NamedTuple):
    """One sample under way: the last accepted point, and the point that a step proposes.

    Attributes:
        tau: Of the last accepted point, and so are the four that follow.
        z: State there.
        slope: dz/dtau there.
        value: V or q of each row there.
        value_slope: d value / d tau along `slope`.
        proposed_tau: Of the proposed point.
        proposed_z: State there.
        goal: Index of the next grid point; beyond the grid where the sample is done.
        left: Halvings left before that point.
        largest_size: Size in tau of the next step at most: half of a refused one, and twice that of the last accepted after it.
        refused_size: Size in tau of the first refused step before the next grid point.
        unexpected: How much faster values rose in that step than their slopes said.
        state: Of the guidance.
        trace: At the grid points that were reached; None if it is not kept.
        path: z at these points; None if it is not kept.
        summary: Of the accepted points.
    """

    tau: Float[Array, ""]
    z: Float[Array, "agents dim"]
    slope: Float[Array, "agents dim"]
    value: Float[Array, " rows"]
    value_slope: Float[Array, " rows"]
    proposed_tau: Float[Array, ""]
    proposed_z: Float[Array, "agents dim"]
    goal: Int[Array, ""]
    left: Int[Array, ""]
    largest_size: Float[Array, ""]
    refused_size: Float[Array, ""]
    unexpected: Float[Array, " rows"]
    state: Any
    trace: TracedReport | None
    path: Float[Array, "points agents dim"] | None
    summary: Summary


class _Decision(NamedTuple):
    """What becomes of a proposed point.

    Attributes:
        over: Which rows are above their limits there.
        accept: Whether it is accepted.
        refuse: Whether it is refused.
        forced: Whether it is accepted although a row is above its limit.
    """

    over: Bool[Array, " rows"]
    accept: Bool[Array, ""]
    refuse: Bool[Array, ""]
    forced: Bool[Array, ""]

    def state(self, recovered: Any, then: Any, before: Any) -> Any:
        """The guidance's state afterwards: that after a forced step, that after any other, or that before."""

        def choose(recovered: Array, then: Array, before: Array) -> Array:
            return jnp.where(self.forced, recovered, jnp.where(self.accept, then, before))

        return jax.tree.map(choose, recovered, then, before)


class GuardedSteps(NamedTuple):
    """How a sample is carried over the grid; each accepted point meets its limits, or is counted as forced.

    Attributes:
        grid: Values of tau from 0 to 1.
        solver: Scheme.
        guard: How often steps are halved.
        keep_trace: Whether the trace is kept.
        keep_path: Whether z is kept at every point of the grid.
        until: Grid point at which samples wait, once it is proposed, for the next macro step; None: they go to the end.
    """

    grid: Float[Array, " points"]
    solver: RungeKutta
    guard: StepGuard
    keep_trace: bool
    keep_path: bool
    until: Float[Array, ""] | None = None

    def start(
        self, rows: int, state: Any, z0: Float[Array, "agents dim"], condition: Any
    ) -> SampleProgress:
        """Progress of a sample that proposes z(0), under guidance with so many rows."""
        points, tau = self.grid.shape[0], self.grid[0]
        row = jnp.zeros(rows, z0.dtype)
        return SampleProgress(
            tau=tau, z=z0, slope=jnp.zeros_like(z0), value=row, value_slope=row,
            proposed_tau=tau, proposed_z=z0, goal=jnp.zeros((), jnp.int32),
            left=jnp.asarray(self.guard.halvings, jnp.int32),
            largest_size=jnp.full_like(tau, jnp.inf), refused_size=jnp.zeros_like(tau),
            unexpected=row, state=state,
            trace=empty_trace(points, rows, z0) if self.keep_trace else None,
            path=jnp.zeros((points, *z0.shape), z0.dtype) if self.keep_path else None,
            summary=empty_summary(self.grid, z0, condition, rows),
        )  # fmt: skip

    def advance(
        self,
        velocity: Velocity,
        on_forced_step: OnForcedStep,
        mask: Bool[Array, " agents"] | None,
        at: SampleProgress,
    ) -> SampleProgress:
        """Evaluates the proposed point, accepts or refuses it, and proposes another; a sample that is done or waits stays."""
        points = self.grid.shape[0]
        at_goal = at.proposed_tau == self.grid[at.goal]
        step = jnp.where(at_goal, at.goal, at.goal - 1)
        then, slope, report = velocity(at.state, step, at.proposed_tau, at.proposed_z)
        size = at.proposed_tau - at.tau
        decision = self._decide(at, report)
        over, accept, refuse, forced = decision
        reached = accept & at_goal
        goal = at.goal + reached
        recovered = on_forced_step(then, at.proposed_tau, report.value, over)
        state = decision.state(recovered, then, at.state)
        unexpected, kinks = _kinks(at, report.value, size, forced & over)
        first_refusal = refuse & (at.left == self.guard.halvings)
        last = at.goal >= points - 1
        point = Point(
            at.proposed_tau, at.proposed_z, report, accept, refuse, over, forced, kinks, last & reached
        )  # fmt: skip
        tau = jnp.where(accept, at.proposed_tau, at.tau)
        z = jnp.where(accept, at.proposed_z, at.z)
        slope = jnp.where(accept, slope, at.slope)
        ahead = self.grid[jnp.minimum(goal, points - 1)]
        largest_size = jnp.where(refuse, size / 2, jnp.where(accept, 2.0, 1.0) * at.largest_size)
        after = _next_tau(tau, ahead, largest_size)
        proposed_z = self.solver.step(
            lambda t, x: velocity(state, goal - 1, t, x)[1], tau, z, slope, after - tau
        )
        trace, path = _kept(at, jnp.where(reached, at.goal, points), report, z)
        return SampleProgress(
            tau=tau, z=z, slope=slope,
            value=jnp.where(accept, report.value, at.value),
            value_slope=jnp.where(accept, report.slope, at.value_slope),
            proposed_tau=after, proposed_z=proposed_z, goal=goal,
            left=jnp.where(reached, self.guard.halvings, at.left - refuse),
            largest_size=largest_size,
            refused_size=jnp.where(first_refusal, size, at.refused_size),
            unexpected=jnp.where(first_refusal, unexpected, at.unexpected),
            state=state, trace=trace, path=path,
            summary=add_point(at.summary, point, mask),
        )  # fmt: skip

    def _decide(self, at: SampleProgress, report: GuidanceReport) -> _Decision:
        """Accepts the proposed point where it is within its limits, or no shorter step is left to try."""
        active = self.unfinished(at)
        # NaN counts as exceeding the limit; no step led to the first point.
        over = ~(report.value <= report.limit) & (at.goal > 0)
        within = ~jnp.any(over)
        size = at.proposed_tau - at.tau
        # Half of a shorter step could be lost in the rounding of tau, and the sample would never move on.
        accept = active & (
            within | (at.left == 0) | (size <= SHORTEST * float(jnp.finfo(size.dtype).eps))
        )
        return _Decision(over, accept, refuse=active & ~accept, forced=accept & ~within)

    def unfinished(self, at: SampleProgress) -> Bool[Array, "..."]:
        """Whether there are points left to evaluate in this macro step; of one sample or of a batch."""
        left = at.goal < self.grid.shape[0]
        if self.until is None:
            return left
        return left & ((at.proposed_tau < self.until) | (self.until == self.grid[-1]))


def _kept(
    at: SampleProgress, spot: Int[Array, ""], report: GuidanceReport, z: States
) -> tuple[Any, Any]:
    """The trace and the path, each None if it is not kept, with a point at `spot`; nothing is written beyond their ends."""
    trace = at.trace
    if trace is not None:
        trace = jax.tree.map(lambda before, new: before.at[spot].set(new), trace, traced(report))
    return trace, None if at.path is None else at.path.at[spot].set(z)


def _kinks(
    at: SampleProgress,
    value: Float[Array, " rows"],
    size: Scalar,
    forced: Bool[Array, " rows"],
) -> tuple[Float[Array, " rows"], Bool[Array, " rows"]]:
    """How much faster values rose in a step than their slopes said, and which rows' forced steps that makes kinks."""
    unexpected = (value - at.value) / jnp.where(size > 0, size, 1.0) - at.value_slope
    much_shorter = size <= at.refused_size / 4
    kinks = forced & much_shorter & (unexpected > UNSMOOTH * at.unexpected)
    # Rounding of the values, over a short step, is no slope.
    rise = jnp.minimum(unexpected * size, at.unexpected * at.refused_size)
    return unexpected, kinks & (rise > rounding(value, at.value))


def _next_tau(tau: Scalar, ahead: Scalar, largest_size: Scalar) -> Scalar:
    """Where the next step ends, `ahead` at most."""
    rest = ahead - tau
    # Of a rest that takes more than one step, the last is no shorter than the one before.
    part = jnp.minimum(largest_size, rest / 2)
    return jnp.where(rest > largest_size, tau + part, ahead)


Advance = Callable[[Any, SampleProgress], SampleProgress]
"""(what a sample is conditioned on, its progress) -> its progress one evaluation later."""


def finish(
    steps: GuardedSteps, advance: Advance, inputs: Any, samples: SampleProgress
) -> SampleProgress:
    """Carries a batch of samples to the end of the macro step; none waits for those that take many more evaluations.

    Args:
        steps: Grid, scheme and guard.
        advance: One evaluation of one sample.
        inputs: What each sample is conditioned on, with a leading axis of samples.
        samples: As `GuardedSteps.start` makes them, with a leading axis of samples.
    """
    on_cpu, count, width = jax.default_backend() == "cpu", len(samples.goal), steps.guard.width
    if on_cpu and width is not None and count > width:
        return _in_turn(steps, advance, inputs, samples, width)
    few = count // (LAST_ON_CPU if on_cpu else LAST) if count >= GATHERED else 0

    def until(left: int, inputs: Any, samples: SampleProgress) -> SampleProgress:
        return jax.lax.while_loop(
            lambda samples: jnp.sum(steps.unfinished(samples)) > left,
            lambda samples: jax.vmap(advance)(inputs, samples),
            samples,
        )

    samples = until(few, inputs, samples)
    if not few:
        return samples
    last = jnp.argsort(~steps.unfinished(samples))[:few]  # all that are unfinished are among them

    def finished(index: Int[Array, "..."], samples: SampleProgress) -> SampleProgress:
        conditions, at = jax.tree.map(lambda leaf: leaf[index], (inputs, samples))
        if index.ndim:
            at = until(0, conditions, at)
        else:
            at = jax.lax.while_loop(steps.unfinished, lambda at: advance(conditions, at), at)
        return jax.tree.map(lambda leaf, new: leaf.at[index].set(new), samples, at)

    if not on_cpu:
        return finished(last, samples)
    return jax.lax.fori_loop(0, few, lambda k, samples: finished(last[k], samples), samples)


class _Places(NamedTuple):
    """Samples that take their steps at once, and all of the batch.

    Attributes:
        number: Of the sample at each place.
        next: Number of the first sample that has had no place yet.
        part: What those at the places are conditioned on, and their progress.
        samples: Progress of all, up to date for those that are done or have had no place.
    """

    number: Int[Array, " places"]
    next: Int[Array, ""]
    part: tuple[Any, SampleProgress]
    samples: SampleProgress


def _in_turn(
    steps: GuardedSteps, advance: Advance, inputs: Any, samples: SampleProgress, width: int
) -> SampleProgress:
    """The samples at a few places take their steps; the next in line takes the place of one that is done."""

    def pick(number: Int[Array, " places"], samples: SampleProgress) -> tuple[Any, SampleProgress]:
        return jax.tree.map(lambda leaf: leaf[number], (inputs, samples))

    def put(places: _Places) -> SampleProgress:
        return jax.tree.map(
            lambda leaf, new: leaf.at[places.number].set(new), places.samples, places.part[1]
        )

    def replaced(places: _Places) -> _Places:
        samples, done = put(places), ~steps.unfinished(places.part[1])
        following = places.next + jnp.cumsum(done) - 1
        enters = done & (following < len(samples.goal))
        number = jnp.where(enters, following, places.number)
        return _Places(number, places.next + jnp.sum(enters), pick(number, samples), samples)

    def some_wait(places: _Places) -> Bool[Array, ""]:
        return places.next < len(samples.goal)

    def step(places: _Places) -> _Places:
        conditions, part = places.part
        places = places._replace(part=(conditions, jax.vmap(advance)(conditions, part)))
        some_done = ~jnp.all(steps.unfinished(places.part[1]))
        return jax.lax.cond(some_done & some_wait(places), replaced, lambda same: same, places)

    number = jnp.arange(width)
    places = _Places(number, jnp.asarray(width), pick(number, samples), samples)
    places = jax.lax.while_loop(
        lambda at: some_wait(at) | jnp.any(steps.unfinished(at.part[1])), step, places
    )
    return put(places)
