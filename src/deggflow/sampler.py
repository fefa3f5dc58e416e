"""Samples of one field by compiled programs: large batches in blocks, padded to the sizes that are compiled."""

from collections.abc import Callable, Hashable
from functools import cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .blocks import block_size, map_padded, padded_batch
from .drift import EVERY_STEP, AbstractDrift
from .flow import Field
from .generation import Generation, generate, generate_batch
from .guidance import AbstractGuidance
from .shapes import States
from .step_guard import StepGuard

Grid = Float[Array, " points"]

Program = Callable[
    [Any, AbstractGuidance, Array, Any, Grid, AbstractDrift, StepGuard | None, bool], Generation
]
"""(field, guidance, z(0), conditions, grid, drift, guard, keep_trace) -> the generation of a batch."""


def masked_batch(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array, "samples agents dim"],
    conditions: Any,
    grid: Grid,
    drift: AbstractDrift,
    guard: StepGuard | None,
    keep_trace: bool,
) -> Generation:
    """`generate_batch` under conditions that have a mask of the agents that are present."""
    return generate_batch(
        field, guidance, z0, conditions, grid=grid, drift=drift, guard=guard,
        mask=conditions.mask, keep_trace=keep_trace,
    )  # fmt: skip


@eqx.filter_jit
def masked_sample(
    field: Field,
    guidance: AbstractGuidance,
    z0: States,
    condition: Any,
    grid: Grid,
    drift: AbstractDrift,
    guard: StepGuard | None,
    keep_trace: bool,
    keep_path: bool,
) -> Generation:
    """`generate`, compiled, under a condition that has a mask of the agents that are present."""
    return generate(
        field, guidance, z0, condition, grid=grid, drift=drift, guard=guard,
        mask=condition.mask, keep_trace=keep_trace, keep_path=keep_path,
    )  # fmt: skip


class Sampler:
    """Generates batches of any size with one field; compiled programs are kept between calls."""

    def __init__(
        self,
        field: Any,
        grid: Grid,
        guard: StepGuard | None,
        program: Program = masked_batch,
        *,
        drift: AbstractDrift = EVERY_STEP,
    ) -> None:
        """Args: field: nominal field; grid: values of tau; guard: of guided steps; program: generates a batch; drift: of `generate`."""
        self._how = grid, drift, guard
        # Blocks take turns on the devices; a block's values do not depend on how many there are.
        self._devices = jax.local_devices()
        self._together = [
            partial(_compiled(program), _on(device, field)) for device in self._devices
        ]
        self._alone = _Alone(program, field, self._how)
        self._known: set[tuple[tuple[int, ...], bool, tuple[str, ...]]] = set()

    def draw(
        self,
        guidance: AbstractGuidance,
        z0: Float[np.ndarray, "samples ..."],
        conditions: Any,
        *,
        keep_trace: bool = False,
    ) -> Generation:
        """Generates samples from given z(0), in float32; all leaves are numpy arrays with an axis of samples.

        Args: as of the program; z(0) has the shape that it takes.
        """
        if len(z0) == 1:
            return self._alone(guidance, z0, conditions, keep_trace)
        # To pick from JAX's arrays takes programs.
        conditions = jax.tree.map(np.asarray, conditions)

        def block(rows: Int[np.ndarray, " samples"]) -> Generation:
            turn = int(rows[0]) // block_size() % len(self._devices)
            inputs = z0[rows], jax.tree.map(lambda leaf: leaf[rows], conditions)
            if len(rows) == 1:  # the last of some
                return self._alone(guidance, *inputs, keep_trace)
            if len(self._devices) > 1:
                inputs = jax.device_put(inputs, self._devices[turn])
            program = self._together[turn]
            return program(guidance, jnp.asarray(inputs[0]), inputs[1], *self._how, keep_trace)

        kind = z0.shape[1:], keep_trace, guidance.names
        generation = map_padded(block, len(z0), compiled=kind in self._known)
        self._known.add(kind)
        return generation


_Settings = tuple[Grid, AbstractDrift, StepGuard | None]


class _Alone:
    """Programs for a single sample, which takes so little time that the arguments of a call must not take more.

    Guidance and settings are taken apart into arrays and the rest when the guidance is another object than in the last call.
    """

    def __init__(self, program: Program, field: Any, how: _Settings) -> None:
        """Args: as of `Sampler`; how: grid, drift and guard."""
        self._program, self._field, self._how = program, field, how
        self._compiled: dict[Hashable, Callable[..., Generation]] = {}
        self._last: tuple[AbstractGuidance, bool, Callable[..., Generation]] | None = None

    def __call__(
        self, guidance: AbstractGuidance, z0: Any, conditions: Any, keep_trace: bool
    ) -> Generation:
        """Generates a sample, as numpy arrays; `z0` and `conditions` have a leading axis of one."""
        last = self._last  # in one piece, as threads share it
        if last is None or last[0] is not guidance or last[1] != keep_trace:
            last = self._last = guidance, keep_trace, self._call(guidance, keep_trace)
        return jax.tree.map(np.asarray, last[2](z0, conditions))

    def _call(self, guidance: AbstractGuidance, keep_trace: bool) -> Callable[..., Generation]:
        arrays, rest = eqx.partition((guidance, self._how), eqx.is_array)
        (arrays, shape), (leaves, structure) = jax.tree.flatten(arrays), jax.tree.flatten(rest)
        kind = structure, tuple(leaves), shape, keep_trace  # None may stand for an array in either
        if kind not in self._compiled:
            # Of a few rows, laying out the weights is most of a product's work: as constants they are laid out once.
            def run(arrays: list[Array], z0: Any, conditions: Any) -> Generation:
                guidance, how = eqx.combine(jax.tree.unflatten(shape, arrays), rest)
                grid, drift, guard = how
                return self._program(
                    self._field, guidance, z0, conditions, grid, drift, guard, keep_trace
                )

            self._compiled[kind] = jax.jit(run)
        return partial(self._compiled[kind], arrays)


def _on(device: jax.Device, field: Any) -> Any:
    """A field with its arrays on a device."""
    if len(jax.local_devices()) == 1:
        return field
    arrays, rest = eqx.partition(field, eqx.is_array)
    return eqx.combine(jax.device_put(arrays, device), rest)


@cache
def _compiled(program: Program) -> Program:
    """One for each program, so that samplers of the same shapes share what is compiled."""
    return eqx.filter_jit(program)


@partial(jax.jit, static_argnames="shape")
def _noise(
    seed: Int[Array, ""],
    numbers: Int[Array, " samples"],
    indices: tuple[Int[Array, ""], ...],
    shape: tuple[int, int],
) -> Float[Array, "samples agents dim"]:
    root = jax.random.key(seed)

    def one(number: Int[Array, ""]) -> States:
        key = jax.random.fold_in(root, number)
        for index in indices:
            key = jax.random.fold_in(key, index)
        return jax.random.normal(key, shape)

    return jax.vmap(one)(numbers)


def numbered_noise(
    seed: int, numbers: Int[np.ndarray, " samples"], *indices: int, shape: tuple[int, int]
) -> Float[np.ndarray, "samples agents dim"]:
    """z(0) ~ N(0, I) of samples by their numbers in a run, the same whatever else is in the batch.

    Args:
        seed: Of the run.
        numbers: Of the samples.
        indices: What else tells draws apart, such as the number of the draw.
        shape: (agents, dim).
    """
    size = padded_batch(len(numbers))
    padded = np.resize(numbers, -(-len(numbers) // size) * size)
    return np.asarray(_noise(seed, padded, indices, shape=shape))[: len(numbers)]
