"""Boxes and discs to keep out of: all of them for the verdict, those nearest to each step for guidance."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.requirements import AbstractObstacle, box, exact
from deggflow.requirements.regions import Each, Positions
from deggflow.requirements.term import hinge, nearest_on_the_way

UNROLLED = 8  # nearest obstacles that are looked at one after the other; programs of more take minutes to compile


class Obstacles(AbstractObstacle):
    """Boxes along the axes that are grown by radii; discs are boxes of size zero.

    Guidance looks at the `nearest` obstacles of each step from a waypoint to the next, those with the least distance
    from its middle. This is exact where no step can be within reach of more, as `condition.crowding` makes sure for
    steps within the speed limit; a longer step violates the speed limit, so that V is not at its floor.

    Attributes:
        centre: Centres.
        half: Half sizes of the boxes.
        radius: By which they are grown.
        nearest: How many guidance looks at.
        few_discs: Whether all are discs, and few: guidance looks at all of them then.
    """

    centre: Float[Array, "obstacles 2"]
    half: Float[Array, "obstacles 2"]
    radius: Float[Array, " obstacles"]
    nearest: int = eqx.field(static=True)
    few_discs: bool = eqx.field(static=True, default=False)

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        """As of `AbstractObstacle`, of the nearest obstacles."""
        first, last = x[..., :-1], x[..., 1:]
        if self.few_discs:
            return self._of_discs(first, last, reach, eps)
        table = jnp.concatenate([self.centre.T, self.half.T, self.radius[None]])
        gap = self._distances(jax.lax.stop_gradient((first + last) / 2))
        if self.nearest > UNROLLED:
            count = min(self.nearest, len(self.radius))
            index = jnp.moveaxis(jax.lax.top_k(-jnp.moveaxis(gap, 0, -1), count)[1], -1, 0)
            rows = table[:, index]
            ends = first[:, None] - rows[:2], last[:, None] - rows[:2]
            return box.segment_repulsion(*ends, rows[2:4], reach + rows[4], eps)
        number, values = jnp.arange(len(self.radius))[:, None, None], []
        for k in range(min(self.nearest, len(self.radius))):
            # By two minima: XLA's CPU backend computes `argmin` one element at a time.
            is_least = gap <= jnp.min(gap, axis=0)[None]
            index = jnp.min(jnp.where(is_least, number, len(self.radius) - 1), axis=0)
            centre_x, centre_y, half_x, half_y, radius = table[:, index]
            centre, half = jnp.stack([centre_x, centre_y]), jnp.stack([half_x, half_y])
            ends = (first - centre)[:, None], (last - centre)[:, None]
            values.append(box.segment_repulsion(*ends, half[:, None], reach + radius[None], eps))
            if k + 1 < self.nearest:
                gap = jnp.where(number == index[None], jnp.inf, gap)
        return jnp.concatenate(values)

    def _of_discs(self, first: Positions, last: Positions, reach: Any, eps: float) -> Each:
        """Of all discs: to measure each takes fewer operations than to find the nearest."""
        start = first[:, None] - self.centre.T[..., None, None]
        near = nearest_on_the_way(start, (last - first)[:, None], eps)
        return hinge(reach + self.radius[:, None, None] - near)

    def _distances(self, point: Positions) -> Each:
        """Signed distances of points from every obstacle, from below inside."""
        over = [
            jnp.abs(point[k][None] - self.centre[:, k, None, None]) - self.half[:, k, None, None]
            for k in range(2)
        ]
        out = [jnp.maximum(each, 0.0) for each in over]
        outside = jnp.sqrt(out[0] ** 2 + out[1] ** 2)
        return outside + jnp.minimum(jnp.maximum(*over), 0.0) - self.radius[:, None, None]

    def clearance(self, x: Positions, swept: bool) -> Each:
        """As of `AbstractObstacle`, of all obstacles."""
        local = x[:, None] - self.centre.T[..., None, None]
        half = self.half.T[..., None, None]
        return (
            exact.segment_from_box(local[..., :-1], local[..., 1:], half)
            - self.radius[:, None, None]
        )
