"""Neighbour search in the plane: a cell list for compiled programs, in O(n log n) time for n points.

Points are sorted by their square cells, row by row. All points within a cell's length of a point are then in three
runs of that order. Nothing depends on the extent of the plane or the number of occupied cells.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Scalar

# Cells along each axis. Points farther out share the outermost cells, which only costs slots.
SIDE = 1 << 14

Keep = Callable[[Int[Array, "points candidates"]], Bool[Array, "points candidates"]]


class Neighbours(NamedTuple):
    """The neighbours of each point, the nearest first.

    Attributes:
        who: Index of the target in each slot; meaningless in an empty slot.
        near: Whether a slot holds a neighbour.
        missed: Whether some point has more neighbours than slots.
    """

    who: Int[Array, "points slots"]
    near: Bool[Array, "points slots"]
    missed: Bool[Array, ""]

    def gather(self, values: Float[Array, " targets"]) -> Float[Array, "points slots"]:
        """The neighbours' entries of an array over targets."""
        return values[self.who]


def find_neighbours(
    points: Float[Array, "points 2"],
    targets: Float[Array, "targets 2"],
    present: Bool[Array, " targets"],
    radius: Scalar,
    slots: int,
    keep: Keep | None = None,
) -> Neighbours:
    """Targets within a radius of each point. No gradient passes through the search.

    Args:
        points: Centres of the search, m.
        targets: Positions of possible neighbours, m.
        present: Which of the targets exist.
        radius: Radius of the search, m; also the length of a cell.
        slots: Largest number of neighbours of a point.
        keep: Maps indices of candidate targets, one row per point, to whether they count; None: all count.
    """
    points, targets = jax.lax.stop_gradient((points, targets))
    runs = _runs(points, targets, present, radius)
    spot = runs.first[..., None] + jnp.arange(slots)[None, None]
    inside = (spot < runs.last[..., None]).reshape(len(points), -1)
    candidates = runs.order[jnp.minimum(spot, len(targets) - 1)].reshape(len(points), -1)
    square = jnp.sum((targets[candidates] - points[:, None]) ** 2, axis=-1)
    close = inside & (square <= radius**2)
    if keep is not None:
        close &= keep(candidates)
    nearest, at = jax.lax.top_k(jnp.where(close, -square, -jnp.inf), slots)
    overflow = jnp.any(runs.last - runs.first > slots) | jnp.any(jnp.sum(close, axis=1) > slots)
    return Neighbours(
        jnp.take_along_axis(candidates, at, axis=1), nearest > -jnp.inf, overflow | jnp.any(jnp.isnan(points))
    )  # fmt: skip


class _Runs(NamedTuple):
    """Runs of each point's three rows of three cells in the order of the targets by cell.

    Attributes:
        order: Indices of the targets, sorted by cell.
        first: Start of each run.
        last: End of each run.
    """

    order: Int[Array, " targets"]
    first: Int[Array, "points 3"]
    last: Int[Array, "points 3"]


def _runs(
    points: Float[Array, "points 2"],
    targets: Float[Array, "targets 2"],
    present: Bool[Array, " targets"],
    radius: Scalar,
) -> _Runs:
    cells = _cells(targets, radius)
    key = jnp.where(present, cells[:, 1] * SIDE + cells[:, 0], SIDE * SIDE)
    order = jnp.argsort(key)
    key = key[order]
    here = _cells(points, radius)
    middle = (here[:, 1:] + jnp.arange(-1, 2)[None]) * SIDE + here[:, :1]
    first = jnp.searchsorted(key, (middle - 1).ravel(), side="left").reshape(-1, 3)
    last = jnp.searchsorted(key, (middle + 1).ravel(), side="right").reshape(-1, 3)
    return _Runs(order, first, last)


def _cells(points: Float[Array, "points 2"], radius: Scalar) -> Int[Array, "points 2"]:
    # The outermost cells stay empty, so that no run of a row reaches into the next row.
    cells = jnp.clip(jnp.floor(points / radius) + SIDE // 2, 2, SIDE - 3)
    return jnp.nan_to_num(cells, nan=2.0).astype(jnp.int32)
