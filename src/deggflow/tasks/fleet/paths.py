"""States of robots: whitened sine modes of a path about the straight line from start to goal."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

WAYPOINTS = 64
MODES = WAYPOINTS - 2
DIM = 2 * MODES

# Standard deviation of mode k of a path about the straight line, in map units: z(0) ~ N(0, I) is then a smooth path.
SCALES = 1.5 / (np.arange(MODES) + 1.0) ** 1.5


def _basis() -> Float[np.ndarray, "waypoints modes"]:
    t, k = np.arange(WAYPOINTS), np.arange(MODES)
    table = np.sqrt(2 / (WAYPOINTS - 1)) * np.sin(np.pi * np.outer(t / (WAYPOINTS - 1), k + 1))
    table[[0, -1]] = 0.0
    return table


BASIS = _basis()  # orthonormal on the inner waypoints, zero at the ends
_SHARE = (np.arange(WAYPOINTS) / (WAYPOINTS - 1))[:, None]  # of the way from start to goal


def _line(
    start: Float[Array | np.ndarray, "*agents 2"],
    goal: Float[Array | np.ndarray, "*agents 2"],
    dtype: Any,
) -> Float[Array, "*agents 64 2"]:
    """Straight lines at an even pace."""
    share = jnp.asarray(_SHARE.reshape(*(1,) * (start.ndim - 1), WAYPOINTS, 1), dtype)
    return (1 - share) * start[..., None, :] + share * goal[..., None, :]


def to_path(
    z: Float[Array | np.ndarray, "*agents 124"],
    start: Float[Array | np.ndarray, "*agents 2"],
    goal: Float[Array | np.ndarray, "*agents 2"],
) -> Float[Array, "*agents 64 2"]:
    """Paths of states, in map units; the first and last waypoints are start and goal, up to rounding.

    Example:
        >>> to_path(jnp.zeros(124), jnp.zeros(2), jnp.array([63.0, 0.0]))[1]
        Array([1., 0.], dtype=float32)
    """
    weights = jnp.asarray(BASIS * SCALES, z.dtype)
    return _line(start, goal, z.dtype) + jnp.einsum(
        "tk,...kd->...td", weights, z.reshape(*z.shape[:-1], MODES, 2)
    )


def modes_of(
    path: Float[Array, "*agents 64 2"],
    start: Float[Array, "*agents 2"],
    goal: Float[Array, "*agents 2"],
) -> Float[Array, "*agents 124"]:
    """States of paths, the inverse of `to_path`.

    Example:
        >>> z = jnp.arange(124.0) / 124
        >>> bool(jnp.allclose(modes_of(to_path(z, z[:2], z[2:4]), z[:2], z[2:4]), z, atol=1e-4))
        True
    """
    weights = jnp.asarray(BASIS.T / SCALES[:, None], path.dtype)
    modes = jnp.einsum("kt,...td->...kd", weights, path - _line(start, goal, path.dtype))
    return modes.reshape(*path.shape[:-2], DIM)


def exact_path(
    z: Float[np.ndarray, "agents 124"],
    starts: Float[np.ndarray, "agents 2"],
    goals: Float[np.ndarray, "agents 2"],
) -> Float[np.ndarray, "agents 64 2"]:
    """Paths in float64, with exactly the starts and goals: what is judged and written.

    Example:
        >>> exact_path(np.zeros((1, 124)), np.zeros((1, 2)), np.array([[0.1, 0.3]]))[0, -1].tolist()
        [0.1, 0.3]
    """
    modes = np.asarray(z, np.float64).reshape(len(z), MODES, 2)
    line = (1 - _SHARE) * starts[:, None] + _SHARE * goals[:, None]
    path = line + (BASIS * SCALES) @ modes
    path[:, 0], path[:, -1] = starts, goals
    return path


def to_modes(path: Float[np.ndarray, "*agents 64 2"]) -> Float[np.ndarray, "*agents 124"]:
    """States of paths in float64, the inverse of `exact_path`.

    Example:
        >>> path = np.random.default_rng(0).normal(size=(3, 64, 2))
        >>> again = exact_path(to_modes(path), path[:, 0], path[:, -1])
        >>> bool(np.allclose(again, path))
        True
    """
    line = (1 - _SHARE) * path[..., :1, :] + _SHARE * path[..., -1:, :]
    modes = (BASIS.T @ (path - line)) / SCALES[:, None]
    return modes.reshape(*path.shape[:-2], DIM)
