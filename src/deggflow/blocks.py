"""Large batches in blocks: on a CPU such that fit a core's cache, with one core per block; larger ones on an accelerator."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Int

A = TypeVar("A")
B = TypeVar("B")

# Samples. The messages of eight times as many no longer fit the cache, and each sample takes twice as long.
BLOCK = 64
# The largest of the sizes below: on a GPU it takes little longer than a block of 64 (benchmarks/accelerator.py).
ACCELERATOR_BLOCK = 512

# Sizes of compiled batches; the last partial batch is padded to one of them.
BATCHES = (1, 16, 64, 128, 512)


def padded_batch(samples: int) -> int:
    """Size of the compiled batch that holds `samples`, at most the largest of `BATCHES`."""
    return next((size for size in BATCHES if size >= samples), BATCHES[-1])


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def block_size() -> int:
    """Samples of a block on the device that JAX uses."""
    return BLOCK if jax.default_backend() == "cpu" else ACCELERATOR_BLOCK


def blocks(count: int) -> list[Int[np.ndarray, " _samples"]]:
    """Indices of samples by block; all blocks but the last are full."""
    size = block_size()
    return [np.arange(k, min(k + size, count)) for k in range(0, count, size)]


def map_blocks(call: Callable[[A], B], parts: Sequence[A], *, compiled: bool = False) -> list[B]:
    """Results of `call` for each part, in order, with one thread per core: a program of small arrays uses only one core.

    Args:
        call: Runs a compiled program and waits for its result.
        parts: Arguments of the calls.
        compiled: Whether the program is compiled already; if not, the first call compiles it for the others.
    """
    if len(parts) < 2 or cores() < 2:
        return [call(part) for part in parts]
    first = [] if compiled else [call(parts[0])]
    with ThreadPoolExecutor(cores()) as pool:
        return first + list(pool.map(call, parts[len(first) :]))


def map_groups(
    call: Callable[[list[int]], Sequence[A]], groups: Sequence[list[int]], count: int
) -> list[A]:
    """Results for number 0 to `count - 1`, which `call` makes group by group, in this thread.

    Example:
        >>> map_groups(lambda group: [10 * k for k in group], [[0, 2], [1]], 3)
        [0, 10, 20]
    """
    results: dict[int, A] = {}
    for group in groups:
        results.update(zip(group, call(group), strict=True))
    return [results[k] for k in range(count)]


def map_padded(
    call: Callable[[Int[np.ndarray, " samples"]], A], count: int, *, compiled: bool = False
) -> A:
    """What `call` makes of samples number 0 to `count - 1`, block by block, joined along the leading axis.

    Args:
        call: Told which samples a block has, some of them several times where it is padded to a size that is compiled;
            runs a compiled program, whose results have a leading axis of samples.
        count: How many samples there are.
        compiled: As in `map_blocks`.
    """

    def padded(block: Int[np.ndarray, " samples"]) -> A:
        results = call(np.resize(block, padded_batch(len(block))))
        return jax.tree.map(lambda leaf: np.asarray(leaf)[: len(block)], results)

    parts = map_blocks(padded, blocks(count), compiled=compiled)
    if len(parts) == 1:
        return parts[0]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
