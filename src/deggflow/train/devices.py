"""Devices of a training run: every one holds the weights, and computes its part of each batch."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

_BATCH = "batch"  # axis of the mesh


class Devices:
    """One device, or several of one or more processes that divide each batch equally.

    Attributes:
        count: Number of devices, those of other processes included.
        writes: Whether this process writes the run's files; one process does.
    """

    def __init__(self, devices: Sequence[jax.Device] | None = None) -> None:
        """Args: devices: The devices; by default JAX's default device, or all devices if there are several processes."""
        if devices is None and jax.process_count() > 1:
            devices = jax.devices()
        self.count = 1 if devices is None else len(devices)
        self.writes = jax.process_index() == 0
        self._mesh = None if devices is None else Mesh(np.array(devices), (_BATCH,))

    def replicate(self, tree: Any) -> Any:
        """The arrays of a tree, whole on every device."""
        return self._place(tree, PartitionSpec())

    def divide(self, index: Array) -> Array:
        """Indices of batches, of shape (steps, batch), divided along the batch."""
        return self._place(index, PartitionSpec(None, _BATCH))

    def divided(self, batch: Any) -> Any:
        """Within a compiled program: keeps a batch's arrays divided along their first axis."""
        if self._mesh is None:
            return batch
        sharding = NamedSharding(self._mesh, PartitionSpec(_BATCH))
        return jax.tree.map(lambda leaf: jax.lax.with_sharding_constraint(leaf, sharding), batch)

    def _place(self, tree: Any, spec: PartitionSpec) -> Any:
        if self._mesh is None:
            return tree
        sharding = NamedSharding(self._mesh, spec)

        def place(leaf: Any) -> Array:
            # Every process has the whole value; `device_put` would compare them.
            value = np.asarray(leaf)
            return jax.make_array_from_callback(value.shape, sharding, lambda part: value[part])

        return jax.tree.map(place, tree)
