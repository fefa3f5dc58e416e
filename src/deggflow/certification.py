"""Certificates of finished samples: our generations, and trajectories made elsewhere."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .arguments import check_leading_axis, check_tau
from .blocks import BATCHES, padded_batch
from .certificate import Certificate, GenerationRecord, RequirementVerdict
from .contradiction import contradictions
from .divergence import END_OF_SCALE, finite
from .generation import Generation, check_one_sample
from .guidance import AbstractRequirement, DecoupledGuidance
from .guidance.decoupled import as_guidance
from .judge import PRECISION, Judged, follow, judge_many
from .recording import agent_names, foreign_record, not_a_number, records, verdicts_of
from .trace import Summary, Trace


class Trajectory(NamedTuple):
    """A generation made elsewhere: states at increasing values of tau.

    Attributes:
        tau: Increasing from 0 to 1.
        z: States there.
    """

    tau: Float[np.ndarray, " points"]
    z: Float[np.ndarray, "points agents dim"]


def certify(
    sample: Generation | Trajectory,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    agents: Sequence[str] | None = None,
    draws: int = 1,
    keep_trace: bool = False,
) -> Certificate:
    """Checks a finished sample, ours or one made elsewhere, against every one of its requirements.

    The verdict is the conjunction of the requirements' own verdicts on z(1), in float64. The record of a
    `Generation` is what guidance reported at every accepted point; a nominal one has none. The record of a `Trajectory`
    is computed here: every requirement's value against its limit at every point, and every agent's row with the agent's
    velocity (z' - z) / (tau' - tau) in place of drift and input, as explicit Euler steps satisfy it.

    Args:
        sample: `generate(...)` of one sample, or states at values of tau.
        requirements: The guidance, or its requirements.
        condition: The condition of the requirements.
        mask: Which agents are present; None: all.
        agents: Names of the agents; "agent 0", ... if None.
        draws: Number of draws so far.
        keep_trace: Also keep the trace in the record.

    Raises:
        TypeError: `sample` is neither, or a requirement rounds its float64 verdict.
        ValueError: Shapes do not fit, tau does not increase from 0 to 1, or absent agents change the verdict.

    Example:
        >>> certificate = certify(generate(field, guidance, z0, condition), guidance, condition)
        >>> print(certificate.table())
        satisfied; least margin ...
        hypotheses hold at all ... points, at most ... apart
        ...
    """
    guidance = as_guidance(requirements)
    if isinstance(sample, Trajectory):
        return _certify_trajectory(sample, guidance, condition, mask, agents, draws, keep_trace)
    check_one_sample(
        "sample", sample, "a `Generation` or a `Trajectory(tau, z)`", "use `certify_batch`"
    )
    one, present = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (sample, mask))
    conditions = jax.tree.map(
        lambda leaf: leaf[None] if eqx.is_array(leaf) else leaf, _exact(condition)
    )
    return _certify_generations(one, present, guidance, conditions, agents, [draws], keep_trace)[0]


def certify_batch(
    samples: Generation,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    mask: Bool[Array | np.ndarray, "samples agents"] | None = None,
    agents: Sequence[str] | None = None,
    draws: Sequence[int] | None = None,
    keep_trace: bool = False,
) -> list[Certificate]:
    """`certify` for many samples in one call, as `generate_batch` or a `vmap` of `generate` returns them.

    Args: as for `certify`; every leaf of `samples` and `condition` and `mask` have a leading axis of samples, `draws`
        has one number for each sample, and all samples share the names `agents`.
    """
    guidance = as_guidance(requirements)
    if not isinstance(samples, Generation) or np.ndim(samples.z) != 3:
        shape = np.shape(samples.z) if isinstance(samples, Generation) else type(samples).__name__
        raise ValueError(
            f"`samples` must be a batch of generations, z of shape (samples, agents, dim); got {shape}."
        )
    check_leading_axis(condition, len(samples.z))
    many, present = jax.tree.map(np.asarray, (samples, mask))
    counts = [1] * len(samples.z) if draws is None else draws
    return _certify_generations(
        many, present, guidance, _exact(condition), agents, counts, keep_trace
    )


def verdicts(
    z: Float[Array | np.ndarray, "agents dim"],
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    agents: Sequence[str] | None = None,
) -> tuple[RequirementVerdict, ...]:
    """The verdict of every requirement on a state in float64, regardless of the state's origin.

    Args: as for `certify`.

    Example:
        >>> [one] = verdicts(generate(field, guidance, z0, condition).z, guidance, condition)
        >>> one.name, one.margin >= 0
        ('apart', True)
    """
    guidance = as_guidance(requirements)
    present = None if mask is None else np.asarray(mask)[None]
    _check_mask(present, (1, len(z)))
    alone = jax.tree.map(lambda leaf: leaf[None] if eqx.is_array(leaf) else leaf, _exact(condition))
    state = np.asarray(z, np.float64)[None]
    judgement = _judge(guidance, state, state, alone, present, np.dtype(np.float64))
    judgement = jax.tree.map(lambda leaf: leaf[0], judgement)
    _check_leaks(judgement, guidance.names)
    return verdicts_of(judgement.margins, guidance.names, guidance.margin_names(), agents)


def _exact(condition: Any) -> Any:
    """A condition in numpy, with floating-point numbers in float64; other leaves stay unchanged."""

    def double(leaf: Any) -> Any:
        if isinstance(leaf, float):
            return np.asarray(leaf, np.float64)
        if not isinstance(leaf, np.ndarray | jax.Array | np.generic):
            return leaf
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            return np.asarray(leaf, np.float64)
        return leaf if jnp.issubdtype(leaf.dtype, jax.dtypes.extended) else np.asarray(leaf)

    return jax.tree.map(double, condition)


def _certify_generations(
    samples: Generation,
    mask: Bool[np.ndarray, "samples agents"] | None,
    guidance: DecoupledGuidance,
    condition: Any,
    agents: Sequence[str] | None,
    draws: Sequence[int],
    keep_trace: bool,
) -> list[Certificate]:
    _check_mask(mask, samples.z.shape[:-1])
    _check_ends(samples.summary)
    kind = samples.summary.z0.dtype
    judgement = _judge(guidance, samples.summary.z0, samples.z, condition, mask, kind)
    why = contradictions(samples, judgement, guidance)
    return _certificates(samples, judgement, guidance, mask, agents, draws, keep_trace, why)


def _judge(
    guidance: DecoupledGuidance,
    z0: Any,
    z: Any,
    condition: Any,
    mask: Bool[np.ndarray, "samples agents"] | None,
    kind: Any,
) -> Judged:
    """The verdicts in float64, as numpy arrays, in batches of the compiled sizes."""
    arrays, rest = eqx.partition(condition, eqx.is_array)
    parts = []
    for begin in range(0, len(z), BATCHES[-1]):
        count = min(BATCHES[-1], len(z) - begin)
        index = begin + np.resize(np.arange(count), padded_batch(count))
        first, last = (np.asarray(each[index], np.float64) for each in (z0, z))
        conditions = eqx.combine(jax.tree.map(lambda leaf, i=index: leaf[i], arrays), rest)
        with jax.enable_x64(True):
            here = None if mask is None else mask[index]
            part = judge_many(guidance, first, last, conditions, here, kind)
        parts.append(jax.tree.map(lambda leaf, n=count: np.asarray(leaf)[:n], part))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _check_mask(mask: np.ndarray | None, shape: tuple[int, ...]) -> None:
    if mask is None:
        return
    if mask.dtype != bool or mask.shape != shape:
        raise ValueError(
            f"`mask` must be boolean of shape {shape}, True for agents that are present; got {mask.dtype} of {mask.shape}."
        )
    if not mask.any(axis=-1).all():
        raise ValueError("`mask` must leave some agent present; got none.")


def _check_ends(summary: Summary) -> None:
    """Raises `ValueError` if a generation does not run from tau = 0 to 1."""
    first, last = np.asarray(summary.first_tau), np.asarray(summary.last_tau)
    whole = (first == 0) & (last == 1)
    if not whole.all():
        k = int(np.argmin(whole))
        raise ValueError(
            f"`sample` must be generated on a grid from tau = 0 to 1; got {first[k]:.6g} to {last[k]:.6g}."
        )
    if not np.all(summary.ordered):
        raise ValueError(
            "`sample` must be generated on a grid that increases; tau fell from one point to the next."
        )


def _check_leaks(judgement: Judged, names: Sequence[str]) -> None:
    """Args: judgement: of one sample or of several."""
    if judgement.leaks.any():
        name = names[int(np.argmax(judgement.leaks)) % len(names)]
        raise ValueError(
            f"the verdict of {name!r} changes with the states of absent agents: leave them out of its function, by a mask "
            "in the condition (`distances(z, mask)` does)."
        )


def _certify_trajectory(
    trajectory: Trajectory,
    guidance: DecoupledGuidance,
    condition: Any,
    mask: Bool[Array | np.ndarray, " agents"] | None,
    agents: Sequence[str] | None,
    draws: int,
    keep_trace: bool,
) -> Certificate:
    tau, z = _checked_trajectory(trajectory)
    present = None if mask is None else np.asarray(mask)
    _check_mask(present, z.shape[1:2])
    # Regardless of the dtype: states whose values are float32 numbers were rounded to float32.
    single = np.array_equal(z.astype(np.float32), z, equal_nan=True)
    kind = np.dtype(np.float32 if single else np.float64)
    eps, precision = np.asarray(np.finfo(str(kind)).eps, np.float64), np.asarray(PRECISION[kind])
    exact = _exact(condition)
    alone = jax.tree.map(lambda leaf: leaf[None] if eqx.is_array(leaf) else leaf, exact)
    with jax.enable_x64(True):
        path_record = follow(guidance, tau, z, eps, precision, exact, present)
    ends = z[:1], z[-1:], alone, None if present is None else present[None], z.dtype
    judgement = _judge(guidance, *ends)
    summary, trace = jax.tree.map(
        lambda leaf: np.asarray(leaf)[None], (path_record.summary, path_record.trace)
    )
    tables: Any = (tau[None], *trace)
    end: Any = z[-1:]
    samples = Generation(end, summary, Trace(*tables), None)
    (certificate,) = _certificates(
        samples, judgement, guidance, ends[3], agents, [draws], keep_trace, [None]
    )
    return certificate


def _checked_trajectory(
    trajectory: Trajectory,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points agents dim"]]:
    tau, z = np.asarray(trajectory.tau), np.asarray(trajectory.z)
    for name, leaf in (("tau", tau), ("z", z)):
        if not (np.issubdtype(leaf.dtype, np.floating) or np.issubdtype(leaf.dtype, np.integer)):
            raise TypeError(f"`{name}` of a trajectory must be real numbers; got {leaf.dtype}.")
    if z.ndim != 3 or tau.shape != (len(z),) or len(z) < 2:
        raise ValueError(
            "a trajectory has at least two points, `tau` of shape (points,) and `z` of shape (points, agents, dim); "
            f"got {tau.shape} and {z.shape}."
        )
    tau, z = tau.astype(np.float64), z.astype(np.float64)
    check_tau("tau", tau)
    return tau, z


def _certificates(
    samples: Generation,
    judgement: Judged,
    guidance: DecoupledGuidance,
    mask: Bool[np.ndarray, "samples agents"] | None,
    agents: Sequence[str] | None,
    draws: Sequence[int],
    keep_trace: bool,
    why: Sequence[str | None],
) -> list[Certificate]:
    """Certificates from the requirements' verdicts, numpy arrays with a leading axis of samples.

    `why`: how each generation contradicts the requirements, in which case nothing is known of the hypotheses.
    """
    names, labels = guidance.names, guidance.margin_names()
    _check_leaks(judgement, names)
    made = _records(samples, judgement, names, agents, keep_trace, why)
    lost = np.asarray(~np.isfinite(samples.z).all(axis=-1))
    if mask is not None:
        lost &= mask
    undefined = np.asarray(samples.summary.not_a_number)
    violations = _violations(judgement)
    certificates = []
    for k, record in enumerate(made):
        verdicts = verdicts_of([each[k] for each in judgement.margins], names, labels, agents)
        missed = [each for each in verdicts if each.reason]
        reason = min(missed, key=lambda each: each.margin).reason if missed else None
        least = min(each.margin for each in verdicts)
        if lost[k].any():
            # Margins of states that are not finite mean nothing: an agent at infinity is far from every obstacle.
            who = agent_names(agents, lost.shape[1])[int(lost[k].argmax())]
            least, reason = -END_OF_SCALE, f"z is not finite at {who}"
            if record is not None and record.hypotheses_hold:
                record = replace(record, hypotheses_hold=False, first_failure=reason)
        if reason is not None and undefined[k]:
            nan = jax.tree.map(lambda leaf, k=k: leaf[k], samples.summary.nan)
            rows = () if record is None else names
            reason = f"{reason}; {not_a_number(nan, rows, agent_names(agents, lost.shape[1]))}"
        certificates.append(
            Certificate(
                reason is None, least, finite(violations[k]), draws[k], reason, record, verdicts
            )
        )
    return certificates


def _records(
    samples: Generation,
    judgement: Judged,
    names: Sequence[str],
    agents: Sequence[str] | None,
    keep_trace: bool,
    why: Sequence[str | None],
) -> list[GenerationRecord | None]:
    """What each generation reported, with the exact values at its end; None of a nominal one."""
    summary, count = samples.summary, len(samples.z)
    if not summary.value.shape[-1]:
        return [None] * count
    made: list[GenerationRecord | None] = [None] * count
    if not all(why):
        excess = np.maximum(summary.excess, judgement.value - judgement.limit)
        excess = np.where(np.isnan(excess), np.inf, excess)
        exact: Any = {"value": judgement.value, "limit": judgement.limit, "excess": excess}
        trace = samples.trace if keep_trace else None
        made = [*records(summary._replace(**exact), names, [agents] * count, trace)]
    for k, text in enumerate(why):
        if text is not None:
            one = jax.tree.map(lambda leaf, k=k: leaf[k], summary)
            made[k] = foreign_record(one, text)
    return made


def _violations(judgement: Judged) -> Float[np.ndarray, " samples"]:
    """Of each sample: V where margins are agents', by how much values are beyond their bounds elsewhere."""
    total = np.zeros(len(judgement.value))
    for row, margins in enumerate(judgement.margins):
        total += judgement.value[:, row] if margins.ndim > 1 else np.maximum(-margins, 0.0)
    return total
