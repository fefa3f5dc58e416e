"""The deviation of one sample bounded step by step, for any drift and any inputs, from its path and the nominal one."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.drift import AbstractDrift, aligned
from deggflow.flow import Field
from deggflow.shapes import Scalar, States

Paths = Float[np.ndarray, "samples points agents dim"]


def drift_along(
    field: Field,
    drift: AbstractDrift,
    grid: Float[Array, " points"],
    path: Float[Array, "points agents dim"],
    condition: Any,
) -> Float[Array, "steps agents dim"]:
    """The drift that a generation takes at each point of a path, the last one excluded.

    Args:
        field: Nominal vector field.
        drift: How often it is evaluated.
        grid: The grid of the generation, before or after its points were moved to where macro steps begin.
        path: States at the points.
        condition: Of the sample.
    """
    grid, starts = aligned(grid, drift.macro_grid())

    def nominal(tau: Scalar, z: States) -> States:
        return field(tau, z, condition)

    begins = jnp.zeros(len(grid), bool).at[starts].set(True)
    ends = jnp.zeros_like(grid).at[starts].set(jnp.append(grid[starts[1:]], grid[-1]))

    def step(state: Any, at: Any) -> tuple[Any, States]:
        tau, after, z, begin, end = at
        if drift.step_evaluations:
            state = jax.lax.cond(
                begin,
                lambda old: drift.step(nominal, old, (tau, end), z),
                lambda old: old,
                state,
            )
        return state, drift.value(nominal, state, (tau, after), tau, z)

    steps = grid[:-1], grid[1:], path[:-1], begins[:-1], ends[:-1]
    return jax.lax.scan(step, drift.init(path[0]), steps)[1]


def step_bound(
    grid: Float[np.ndarray, " points"],
    nominal: Paths,
    guided: Paths,
    difference: Float[np.ndarray, "samples steps agents dim"],
    *,
    uniform: bool = False,
) -> Float[np.ndarray, " samples"]:
    """An upper bound on |z(1) - y(1)| of each pair of a guided path z and a nominal path y.

    With Delta = z - y and the difference d of the two drifts, a step of length h takes Delta to Delta + h d + r, where
    the rest r is h g u for an explicit Euler step (and includes rounding, and whatever a halved step does otherwise). So
    |Delta'| <= s |Delta| + |r| with s = |Delta + h d| / |Delta| = sqrt(1 + 2 h m + h^2 q^2). The recursion starts at
    |Delta(0)|, which is zero for the same z(0).

    Args:
        grid: tau at the points of the paths.
        nominal: y.
        guided: z.
        difference: Drift along z minus drift along y.
        uniform: Take the largest s over the samples in every step, as a bound without knowledge of the pair would.

    Returns:
        Bounds in the unit of z.
    """
    gap = (guided - nominal).reshape(*guided.shape[:2], -1).astype(np.float64)
    step = np.diff(grid.astype(np.float64))[None, :, None]
    carried = gap[:, :-1] + step * difference.reshape(*difference.shape[:2], -1)
    length = np.linalg.norm(gap, axis=-1)
    apart = length[:, :-1] > 0
    # Where the two coincide nothing is stretched: whatever parts them counts as the rest.
    rest = np.linalg.norm(gap[:, 1:] - np.where(apart[..., None], carried, 0.0), axis=-1)
    stretch = np.linalg.norm(carried, axis=-1) / np.where(apart, length[:, :-1], 1.0)
    stretch = np.where(apart, stretch, 0.0)
    if uniform:
        stretch = np.broadcast_to(np.max(stretch, axis=0), stretch.shape)
    bound = length[:, 0]
    for factor, summand in zip(stretch.T, rest.T, strict=True):
        bound = factor * bound + summand
    return np.asarray(bound)
