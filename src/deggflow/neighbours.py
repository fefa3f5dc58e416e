"""Who is near whom in the plane: a cell list for compiled programs, in time n log n of n points.

Points are sorted by the square cell they lie in, row by row; whoever is within a cell's length of a point is then in
three runs of that order. Nothing depends on how large the plane is or how many cells are taken.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Scalar

SIDE = (
    1 << 14
)  # cells along each axis; farther out they are taken together, which costs room in the lists alone

Keep = Callable[[Int[Array, "points found"]], Bool[Array, "points found"]]


class Neighbours(NamedTuple):
    """For each point who is near, the nearest first."""

    who: Int[Array, "points slots"]  # which of the targets; of no meaning where the slot is empty
    near: Bool[Array, "points slots"]  # whether there is somebody in the slot
    missed: Bool[Array, ""]  # whether some point has more neighbours than slots

    def gather(self, values: Float[Array, " targets"]) -> Float[Array, "points slots"]:
        """A number of each neighbour's."""
        return values[self.who]


def find_neighbours(
    points: Float[Array, "points 2"],
    targets: Float[Array, "targets 2"],
    present: Bool[Array, " targets"],
    radius: Scalar,
    slots: int,
    keep: Keep | None = None,
) -> Neighbours:
    """Targets within a radius of each point. No gradient passes through it.

    Args:
        points: Where to look from, m.
        targets: Who may be found, m.
        present: Which of the targets exist.
        radius: How far to look, m; also the length of a cell.
        slots: Room for each point's neighbours.
        keep: Which of the targets found (their indices, one row per point) count at all; everybody if None.
    """
    points, targets = jax.lax.stop_gradient((points, targets))
    runs = _runs(points, targets, present, radius)
    spot = runs.first[..., None] + jnp.arange(slots)[None, None]
    inside = (spot < runs.last[..., None]).reshape(len(points), -1)
    found = runs.order[jnp.minimum(spot, len(targets) - 1)].reshape(len(points), -1)
    square = jnp.sum((targets[found] - points[:, None]) ** 2, axis=-1)
    close = inside & (square <= radius**2)
    if keep is not None:
        close &= keep(found)
    nearest, at = jax.lax.top_k(jnp.where(close, -square, -jnp.inf), slots)
    crowded = jnp.any(runs.last - runs.first > slots) | jnp.any(jnp.sum(close, axis=1) > slots)
    return Neighbours(
        jnp.take_along_axis(found, at, axis=1), nearest > -jnp.inf, crowded | jnp.any(jnp.isnan(points))
    )  # fmt: skip


class _Runs(NamedTuple):
    """Where each point's three rows of three cells begin and end in the order of the targets by cell."""

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
    # The outermost cells stay free: no row's run may reach into the next row.
    cells = jnp.clip(jnp.floor(points / radius) + SIDE // 2, 2, SIDE - 3)
    return jnp.nan_to_num(cells, nan=2.0).astype(jnp.int32)
