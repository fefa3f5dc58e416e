"""The data of each stretch of steps: the whole dataset and indices, or only the samples that these steps draw."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .devices import Devices
from .settings import Dataset
from .store import StoredDataset

_BYTES = 128 << 20  # of samples that are read at once


class Stretch(NamedTuple):
    """Data of consecutive steps.

    Attributes:
        data: Samples.
        batches: The batch of each step, by its samples' numbers in `data`.
    """

    data: Dataset
    batches: Int[Array, "steps batch"]


def stretch_length(training: Dataset | StoredDataset, steps: int, batch: int) -> int:
    """Steps of a stretch: a divisor of `steps`, so that one compiled program serves all."""
    if not isinstance(training, StoredDataset):
        return steps
    most = max(1, _BYTES // (batch * training.row_bytes))
    return max(k for k in range(1, steps + 1) if steps % k == 0 and k <= most)


def stretches(
    training: Dataset | StoredDataset,
    starts: Sequence[int],
    draw: Callable[[int], Int[np.ndarray, "steps batch"]],
    devices: Devices,
) -> Iterator[Stretch]:
    """The stretches that begin with these steps.

    Args:
        training: In memory, or in a file of which the next stretch is read while the current one is computed.
        starts: First step of each stretch.
        draw: Indices of the batches of a stretch, by its first step.
        devices: Of the run.
    """
    if not isinstance(training, StoredDataset):
        data = devices.replicate(training)
        for start in starts:
            yield Stretch(data, devices.divide(jnp.asarray(draw(start))))
        return

    def read(start: int) -> Stretch:
        index = draw(start)
        own = np.arange(index.size, dtype=index.dtype).reshape(index.shape)
        rows = jax.tree.map(np.ascontiguousarray, training.rows(index.reshape(-1)))
        data = devices.replicate(jax.tree.map(jnp.asarray, rows))
        return Stretch(data, devices.divide(jnp.asarray(own)))

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(read, starts[0]) if starts else None
        for following in (*starts[1:], None):
            assert coming is not None
            stretch = coming.result()
            coming = None if following is None else pool.submit(read, following)
            yield stretch
