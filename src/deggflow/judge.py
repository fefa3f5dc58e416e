"""The compiled part of certificates: what requirements say of finished samples in float64."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Integer

from deggflow.shapes import Mask, Scalar, States

from .guidance import DecoupledGuidance, GuidanceReport
from .guidance.decoupled import opposed_sine
from .guidance.report import not_finite
from .guidance.requirement import Rows
from .identity import fingerprint
from .trace import Point, Summary, TracedReport, add_point, empty_summary, traced

PRECISION = {np.dtype(np.float32): 1e-5, np.dtype(np.float64): 1e-9}
"""Of |ell| |dz/dtau| + |b|, by the type in which states were computed: rows met as closely are met."""
TINY = 1e-300
SAME = 1e-12  # relative: the rounding of one margin, computed twice in one program
NEAR = 1e-5  # of 1 + |z|: either side of a point at which a requirement's gradient is looked at
UNSMOOTH = 0.5  # by which the jump of a slope shrinks at most where there is a kink, as `NEAR` is quartered


class Judged(NamedTuple):
    """One finished sample, judged by the requirements themselves.

    Attributes:
        margins: As `AbstractRequirement.margins_at_end`.
        value: V or q at tau = 1.
        limit: Limit there.
        first_value: V or q at z(0).
        first_limit: Limit there.
        leaks: Whether the states of absent agents change the verdict.
        condition: `fingerprint` of the condition asked about, in the type in which a generation saw it.
    """

    margins: tuple[Float[Array, "..."], ...]
    value: Float[Array, " rows"]
    limit: Float[Array, " rows"]
    first_value: Float[Array, " rows"]
    first_limit: Float[Array, " rows"]
    leaks: Bool[Array, " rows"]
    condition: Integer[Array, " leaves"]


def judge(
    guidance: DecoupledGuidance, z0: States, z: States, condition: Any, mask: Mask, dtype: Any
) -> Judged:
    """The verdict on z(1), and what a generation under these requirements, in states of `dtype`, began and ended with."""
    margins = guidance.margins_at_end(z, condition, mask)
    leaks = jnp.zeros(len(guidance.names), bool)
    if mask is not None:
        # Absent agents somewhere else: nothing that is said of the others may change.
        steps = 1.0 + jnp.arange(z.size, dtype=z.dtype).reshape(z.shape) / z.size
        is_finite = jnp.isfinite(z)
        far = 1.0 + jnp.max(jnp.where(is_finite, jnp.abs(z), 0.0))
        elsewhere = jnp.where(mask[:, None], z, steps * far)
        margins_elsewhere = guidance.margins_at_end(elsewhere, condition, mask)
        leaks = jnp.stack([
            jnp.any(~((a == b) | (jnp.abs(a - b) <= SAME * (1 + jnp.abs(a))) | (jnp.isnan(a) & jnp.isnan(b))))
            for a, b in zip(margins, margins_elsewhere, strict=True)
        ]) & jnp.all(is_finite | ~mask[:, None])  # fmt: skip
    zero, one = jnp.zeros((), z.dtype), jnp.ones((), z.dtype)
    state = guidance.init(z0, condition, mask)
    first = guidance.rows(state, zero, z0, jnp.zeros_like(z0), condition, mask)
    last = guidance.rows(state, one, z, jnp.zeros_like(z), condition, mask)
    return Judged(
        margins,
        last.value,
        last.limit,
        first.value,
        first.limit,
        leaks,
        fingerprint(condition, dtype),
    )


@eqx.filter_jit
def judge_many(
    guidance: DecoupledGuidance,
    z0: Float[Array | np.ndarray, "samples agents dim"],
    z: Float[Array | np.ndarray, "samples agents dim"],
    condition: Any,
    mask: Bool[Array | np.ndarray, "samples agents"] | None,
    dtype: Any,
) -> Judged:
    """The same of a batch; arrays of `condition` have a leading axis of samples."""
    arrays, rest = eqx.partition(condition, eqx.is_array)
    starts, ends = jnp.asarray(z0), jnp.asarray(z)
    present = None if mask is None else jnp.asarray(mask)

    def one(z0: Array, z: Array, arrays: Any, mask: Array | None) -> Judged:
        return judge(guidance, z0, z, eqx.combine(arrays, rest), mask, dtype)

    return jax.vmap(one)(starts, ends, arrays, present)


class Followed(NamedTuple):
    """A trajectory made elsewhere, as guidance would have reported it.

    Attributes:
        summary: Of all its points.
        trace: Of all its points; leaves have a leading axis of points.
    """

    summary: Summary
    trace: TracedReport


@eqx.filter_jit
def follow(
    guidance: DecoupledGuidance,
    tau: Float[Array | np.ndarray, " points"],
    z: Float[Array | np.ndarray, "points agents dim"],
    eps: Float[Array | np.ndarray, ""],
    precision: Float[Array | np.ndarray, ""],
    condition: Any,
    present: Bool[Array | np.ndarray, " agents"] | None,
) -> Followed:
    """Every point's values and rows, in which the trajectory's velocity stands for drift and input.

    Args:
        guidance: Whose requirements.
        tau: From 0 to 1.
        z: States.
        eps: Precision to which states were rounded.
        precision: Of `PRECISION`: how closely a row has to be met.
        condition: What the requirements are conditioned on.
        present: Which agents are present; None: all.
    """
    tau, z = jnp.asarray(tau), jnp.asarray(z)
    mask = None if present is None else jnp.asarray(present)
    step = jnp.diff(tau)
    # The last point has no velocity; a standstill asks nothing of it.
    still = jnp.zeros_like(z[:1])
    velocity = jnp.concatenate([jnp.diff(z, axis=0) / step[:, None, None], still])
    # What rounding of an agent's two states can make of its velocity.
    size = jnp.linalg.norm(z, axis=-1)
    rounding = eps * (size[:-1] + size[1:]) / step[:, None]
    rounding = jnp.concatenate([rounding, jnp.zeros_like(size[:1])])
    state = guidance.init(z[0], condition, mask)

    def at(
        so_far: Summary, point: tuple[Array, Array, Array, Array, Array]
    ) -> tuple[Summary, TracedReport]:
        tau, z, velocity, rounding, last = point
        rows = guidance.rows(state, tau, z, velocity, condition, mask)
        ell_norm = jnp.linalg.norm(rows.ell, axis=-1)
        speed = jnp.linalg.norm(velocity, axis=-1)
        room = ell_norm * (precision * speed + rounding)[None] + precision * jnp.abs(rows.b) + TINY
        active = (jnp.abs(rows.b) <= room) & (ell_norm > 0)
        report = _report(rows, velocity, rows.b <= room, ell_norm, active)
        flat = jnp.zeros(len(guidance.names), bool)
        kinks = flat | _kinks(guidance, tau, z, velocity, condition, mask)
        yes, no = jnp.asarray(True), jnp.asarray(False)
        here = Point(tau, z, report, yes, no, flat, no, kinks & ~last, last)
        return add_point(so_far, here, mask), traced(report)

    points = jnp.arange(len(tau))
    start = empty_summary(tau, z[0], condition, len(guidance.names))
    summary, trace = jax.lax.scan(at, start, (tau, z, velocity, rounding, points == len(tau) - 1))
    work = summary.work._replace(evaluations=jnp.asarray(len(tau)))
    return Followed(summary._replace(work=work), trace)


def _report(
    rows: Rows,
    velocity: States,
    met: Bool[Array, "rows agents"],
    ell_norm: Float[Array, "rows agents"],
    active: Bool[Array, "rows agents"],
) -> GuidanceReport:
    agents = len(velocity)
    nobody, none = jnp.zeros(agents, bool), jnp.zeros(agents, velocity.dtype)
    return GuidanceReport(
        value=rows.value, bound=rows.bound, limit=rows.limit, row_feasible=met,
        qp_infeasible=nobody, input_norm=none, ell_norm=jnp.where(active, ell_norm, jnp.inf),
        active=active, opposed_sine=opposed_sine(rows.ell, active), slope=rows.rate,
        contribution=rows.contribution,
        drift_nan=not_finite(velocity), value_nan=rows.value_nan,
        gradient_nan=rows.gradient_nan, input_nan=nobody,
    )  # fmt: skip


def _kinks(
    guidance: DecoupledGuidance,
    tau: Scalar,
    z: States,
    velocity: States,
    condition: Any,
    mask: Mask,
) -> Bool[Array, " rows"]:
    """Requirements whose slope along the trajectory jumps at this very point, however closely one looks.

    The second difference over the step length: it falls with the step where the requirement is smooth.
    """
    speed = jnp.sqrt(jnp.sum(velocity**2))
    along = velocity / jnp.where(speed > 0, speed, 1.0)
    here = guidance.values(tau, z, condition, mask)

    def jump(near: Array) -> tuple[Array, Array]:
        ahead = guidance.values(tau, z + near * along, condition, mask)
        behind = guidance.values(tau, z - near * along, condition, mask)
        return jnp.abs(ahead + behind - 2 * here) / near, jnp.abs(ahead - behind) / near

    near = NEAR * (1.0 + jnp.sqrt(jnp.sum(z**2)))
    (wide, _), (close, change) = jump(near), jump(near / 4)
    clear = close > 1e-3 * change + 1e-9 * (1.0 + jnp.abs(here)) / near * 1e-3
    return (close > UNSMOOTH * wide) & clear & (speed > 0)
