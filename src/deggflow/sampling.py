"""Certified samples in one call: drawn in blocks, judged, drawn again where a requirement is missed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .arguments import check_leading_axis
from .blocks import blocks, map_blocks, padded_batch
from .certificate import Certificate
from .certification import certify_batch
from .drift import EVERY_STEP, AbstractDrift
from .flow import Field
from .generation import GUARD, Generation, check_settings, generate_batch
from .guidance import (
    AbstractGuidance,
    AbstractRequirement,
    DecoupledGuidance,
    NoGuidance,
)
from .guidance.decoupled import as_guidance
from .notebook import samples_html
from .redraw import Candidate, Drawn, redraw_until_satisfied
from .solver import EULER, RungeKutta
from .step_guard import StepGuard

MAX_DRAWS = 8

Initial = Callable[[PRNGKeyArray, tuple[int, int]], Float[Array, "agents dim"]]
"""p_0: (key, (agents, dim)) -> z(0)."""


class Progress(NamedTuple):
    """How far `sample` has come.

    Attributes:
        draw: Number of the present draw, from 1.
        completed: Samples of this draw that are generated and judged.
        pending: All samples of this draw.
        satisfied: Samples that are satisfied so far, of all draws.
        total: Samples in all.
    """

    draw: int
    completed: int
    pending: int
    satisfied: int
    total: int


@dataclass(frozen=True)
class Samples:
    """Finished samples with their certificates, in order.

    Attributes:
        z: States at tau = 1, shape (samples, agents, dim).
        certificates: One for each sample.
    """

    z: Float[np.ndarray, "samples agents dim"]
    certificates: tuple[Certificate, ...]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.certificates)

    @property
    def satisfied(self) -> Bool[np.ndarray, " samples"]:
        """Which of them meet every requirement."""
        return np.array([each.satisfied for each in self.certificates])

    @property
    def unmet(self) -> dict[int, str]:
        """Why the others do not, by their numbers."""
        return {
            k: each.reason for k, each in enumerate(self.certificates) if each.reason is not None
        }

    def _repr_html_(self) -> str:
        """What notebooks show."""
        return samples_html(self)

    def __str__(self) -> str:
        """In one line, and one more for each of the first few that were refused."""
        first = sum(each.satisfied and each.draws == 1 for each in self.certificates)
        head = f"{self.satisfied.sum()} of {len(self)} samples satisfied, {first} at the first draw"
        some = [f"  sample {k}: {reason}" for k, reason in list(self.unmet.items())[:3]]
        more = [f"  and {len(self.unmet) - 3} more"] if len(self.unmet) > 3 else []
        return "\n".join([head, *some, *more])


def sample(
    field: Field,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    key: PRNGKeyArray,
    count: int,
    shape: tuple[int, int],
    conditions: Any = None,
    mask: Bool[np.ndarray | Array, " agents"] | None = None,
    masks: Bool[np.ndarray | Array, "samples agents"] | None = None,
    initial: Initial = jax.random.normal,
    max_draws: int = MAX_DRAWS,
    guided: bool = True,
    grid: Float[np.ndarray | Array, " points"] | None = None,
    solver: RungeKutta = EULER,
    drift: AbstractDrift = EVERY_STEP,
    guard: StepGuard | None = GUARD,
    agents: Sequence[str] | None = None,
    keep_trace: bool = False,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> Samples:
    """Samples with certificates; what misses a requirement is drawn again from a new z(0).

    A sample depends on the key and on its own number alone, whatever is drawn beside it. Programs are compiled once
    for one field, guidance and shape and kept between calls.

    Args:
        field: Nominal vector field, any callable (tau, z, condition) -> dz/dtau.
        requirements: Requirements, or a `DecoupledGuidance` of them.
        condition: One condition for all samples; any pytree.
        key: Decides z(0), with the number of the sample and of the draw.
        count: How many samples.
        shape: (agents, dim) of a state.
        conditions: One condition for each sample instead: leaves have a leading axis of `count`.
        mask: Which agents of a padded team are present, for all samples; None: all.
        masks: The same for each sample.
        initial: p_0, from which z(0) is drawn; N(0, I) by default.
        max_draws: Limit of draws of each sample; where none is satisfied the closest is returned, with the reason.
        guided: False for nominal samples, drawn once and judged by the same requirements.
        grid: As of `generate`.
        solver: As of `generate`.
        drift: As of `generate`.
        guard: As of `generate`.
        agents: What certificates call the agents; "agent 0", ... if None.
        keep_trace: Certificates have every requirement's value against its limit at every grid point.
        on_progress: Told after every block of samples.

    Raises:
        TypeError: An argument is not of its type.
        ValueError: A shape does not fit, or `count` or `max_draws` is not positive.

    Example:
        >>> result = sample(field, (apart,), condition, key=jax.random.key(0), count=512, shape=(5, 2))
        >>> print(result)
        512 of 512 samples satisfied, 512 at the first draw
    """
    judge = as_guidance(requirements)
    check_settings(solver, drift, guard)
    _check_key(key)
    _check(count, shape, condition, conditions, mask, masks)
    guidance: AbstractGuidance = judge if guided else NoGuidance()
    run = _Run(
        field, guidance, judge, key, (shape[0], shape[1]), initial, condition, conditions,
        _masks(mask, masks, count), grid, solver, drift, guard if guided else None, agents, keep_trace,
    )  # fmt: skip
    results = run.all_samples(count, max_draws if guided else 1, on_progress)
    return Samples(
        np.stack([each.sample.z for each in results]),
        tuple(replace(each.sample.certificate, draws=each.draws) for each in results),
    )


class _Sample(NamedTuple):
    z: Float[np.ndarray, "agents dim"]
    certificate: Certificate


CHUNK = 512  # samples between two reports of progress


def _chunks(count: int) -> list[slice]:
    return [slice(k, min(k + CHUNK, count)) for k in range(0, count, CHUNK)]


def _check(count: int, shape: Any, condition: Any, conditions: Any, mask: Any, masks: Any) -> None:
    if not isinstance(count, int) or count < 1:
        raise ValueError(f"`count` must be a positive number of samples; got {count!r}.")
    sizes = tuple(shape) if isinstance(shape, tuple | list) else ()
    if len(sizes) != 2 or not all(isinstance(size, int) and size > 0 for size in sizes):
        raise ValueError(f"`shape` must be (agents, dim) of a state; got {shape!r}.")
    if condition is not None and conditions is not None:
        raise ValueError(
            "`condition` is one for all samples, `conditions` one for each: pass one of the two."
        )
    if mask is not None and masks is not None:
        raise ValueError(
            "`mask` is one for all samples, `masks` one for each: pass one of the two."
        )
    for name, value, expected in (("mask", mask, sizes[:1]), ("masks", masks, (count, sizes[0]))):
        if value is not None and (np.shape(value) != expected or np.asarray(value).dtype != bool):
            raise ValueError(
                f"`{name}` must be boolean of shape {expected}, True for agents that are present; got "
                f"{np.asarray(value).dtype} of {np.shape(value)}."
            )
    if conditions is not None:
        check_leading_axis(conditions, count, "conditions")
    for name, value in (("condition", condition), ("conditions", conditions)):
        for path, leaf in jax.tree_util.tree_leaves_with_path(value):
            arrays = isinstance(leaf, jax.Array | np.ndarray | np.generic | float | int)
            if not arrays or jnp.issubdtype(jnp.result_type(leaf), jax.dtypes.extended):
                raise TypeError(
                    f"every leaf of `{name}` must be a number or an array, as it goes into a compiled program; got "
                    f"{leaf!r} at {name}{jax.tree_util.keystr(path)}."
                )


def _check_key(key: Any) -> None:
    typed = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    raw = isinstance(key, jax.Array | np.ndarray) and key.dtype == np.uint32
    if not (typed or raw):
        raise TypeError(f"`key` must be a key of JAX, such as jax.random.key(0); got {key!r}.")


def _masks(mask: Any, masks: Any, count: int) -> Bool[np.ndarray, "samples agents"] | None:
    if mask is not None:
        return np.broadcast_to(np.asarray(mask), (count, len(mask)))
    return None if masks is None else np.asarray(masks)


class _Run(NamedTuple):
    """The settings of one call."""

    field: Field
    guidance: AbstractGuidance
    judge: DecoupledGuidance
    key: PRNGKeyArray
    shape: tuple[int, int]
    initial: Initial
    condition: Any
    conditions: Any
    masks: Bool[np.ndarray, "samples agents"] | None
    grid: Any
    solver: RungeKutta
    drift: AbstractDrift
    guard: StepGuard | None
    agents: Sequence[str] | None
    keep_trace: bool

    def all_samples(
        self, count: int, max_draws: int, on_progress: Callable[[Progress], None]
    ) -> list[Drawn[_Sample]]:
        """Every sample at the first draw that satisfies the requirements, or the closest."""
        satisfied = 0

        def attempt(pending: Sequence[int], number: int) -> list[Candidate[_Sample]]:
            nonlocal satisfied
            out: list[Candidate[_Sample]] = []
            for part in _chunks(len(pending)):
                out += self.draw(np.asarray(pending)[part], number)
                satisfied += sum(each.satisfied for each in out[part.start :])
                on_progress(Progress(number + 1, len(out), len(pending), satisfied, count))
            return out

        return redraw_until_satisfied(attempt, count, max_draws)

    def draw(self, numbers: Int[np.ndarray, " samples"], draw: int) -> list[Candidate[_Sample]]:
        """Samples of these numbers, drawn once and judged."""
        parts = map_blocks(
            partial(self._block, draw), [numbers[part] for part in blocks(len(numbers))]
        )
        generations = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
        conditions = self._conditions_of(numbers)
        masks = None if self.masks is None else self.masks[numbers]
        certificates = certify_batch(
            generations, self.judge, conditions, mask=masks, agents=self.agents,
            draws=[draw + 1] * len(numbers), keep_trace=self.keep_trace,
        )  # fmt: skip
        return [
            Candidate(_Sample(z, each), each.satisfied, each.min_margin)
            for z, each in zip(generations.z, certificates, strict=True)
        ]

    def _conditions_of(self, numbers: Int[np.ndarray, " samples"]) -> Any:
        """Conditions of samples, with a leading axis."""
        if self.conditions is not None:
            return jax.tree.map(lambda leaf: np.asarray(leaf)[numbers], self.conditions)
        return jax.tree.map(
            lambda leaf: np.broadcast_to(np.asarray(leaf), (len(numbers), *np.shape(leaf))),
            self.condition,
        )

    def _block(self, draw: int, numbers: Int[np.ndarray, " samples"]) -> Generation:
        padded = np.resize(numbers, padded_batch(len(numbers)))
        masks = None if self.masks is None else self.masks[padded]
        generations = _program(
            self.field, self.guidance, self.key, padded, np.asarray(draw), self.shape, self.initial,
            self._conditions_of(padded), masks, self.grid, self.solver, self.drift, self.guard,
            self.keep_trace,
        )  # fmt: skip
        return jax.tree.map(lambda leaf: np.asarray(leaf)[: len(numbers)], generations)


@eqx.filter_jit
def _program(
    field: Field,
    guidance: AbstractGuidance,
    key: PRNGKeyArray,
    numbers: Int[Array | np.ndarray, " samples"],
    draw: Int[Array | np.ndarray, ""],
    shape: tuple[int, int],
    initial: Initial,
    conditions: Any,
    masks: Bool[Array | np.ndarray, "samples agents"] | None,
    grid: Float[Array | np.ndarray, " points"] | None,
    solver: RungeKutta,
    drift: AbstractDrift,
    guard: StepGuard | None,
    keep_trace: bool,
) -> Generation:
    def start(number: Int[Array, ""]) -> Float[Array, "agents dim"]:
        own = jax.random.fold_in(jax.random.fold_in(key, number), draw)
        z0 = initial(own, shape)
        if jnp.shape(z0) != shape:
            raise ValueError(f"`initial` must return z(0) of shape {shape}; got {jnp.shape(z0)}.")
        return z0

    z0 = jax.vmap(start)(jnp.asarray(numbers))
    return generate_batch(
        field, guidance, z0, conditions, grid=grid, solver=solver, drift=drift, guard=guard,
        mask=masks, keep_trace=keep_trace,
    )  # fmt: skip
