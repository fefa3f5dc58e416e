"""Checks of what a generation is given."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .shapes import States


def checked_start(z0: Any, ndim: int) -> Array:
    """z(0) as an array of JAX."""
    start = z0 if isinstance(z0, jax.Array | np.ndarray) else np.asarray(z0)
    shape = "(agents, dim)" if ndim == 2 else "(samples, agents, dim)"
    if not jnp.issubdtype(start.dtype, jnp.floating):
        raise TypeError(f"`z0` must be a floating-point array of shape {shape}; got {start.dtype}.")
    if start.ndim != ndim or 0 in start.shape:
        other = {2: " `generate` takes one sample.", 3: " `generate_batch` takes a batch."}
        hint = other.get(start.ndim, "") if start.ndim != ndim else ""
        raise ValueError(f"`z0` must have shape {shape}; got {start.shape}.{hint}")
    return jnp.asarray(start)


def checked_grid(grid: Any, default: Callable[[], Array], z0: Any) -> Float[Array, " points"]:
    """The grid in the type of the states; its values are looked at where they are known."""
    dtype = jnp.asarray(z0).dtype
    if grid is None:
        grid = default()
    elif not isinstance(grid, jax.Array):
        grid = np.asarray(grid, np.float64)
    if grid.ndim != 1 or len(grid) < 2:
        raise ValueError(
            f"`grid` must be at least two values of tau, of shape (points,); got shape {grid.shape}."
        )
    if not isinstance(grid, jax.core.Tracer):
        check_tau("grid", np.asarray(np.asarray(grid, dtype), np.float64))
    return jnp.asarray(grid, dtype)


def check_tau(name: str, tau: Float[np.ndarray, " points"]) -> None:
    """Raises `ValueError` unless values of tau increase from 0 to 1."""
    if not (np.diff(tau) > 0).all():
        k = int(np.argmin(np.diff(tau) > 0))
        raise ValueError(
            f"`{name}` must increase; got {tau[k]:.6g} before {tau[k + 1]:.6g} at point {k + 1}."
        )
    if tau[0] != 0 or tau[-1] != 1:
        raise ValueError(f"`{name}` must go from 0 to 1; got {tau[0]:.6g} to {tau[-1]:.6g}.")


def per_agent(name: str, value: Any, z0: Any, dtype: Any) -> Array | None:
    """A value for each agent (and sample), in a type."""
    if value is None:
        return None
    array = value if isinstance(value, jax.Array | np.ndarray) else np.asarray(value)
    if dtype is bool and array.dtype != bool:
        raise TypeError(
            f"`{name}` must be boolean, True for agents that are present; got {array.dtype}."
        )
    if array.shape != z0.shape[:-1]:
        raise ValueError(
            f"`{name}` must have shape {z0.shape[:-1]}, one value for each agent; got {array.shape}."
        )
    if dtype is not bool and not isinstance(array, jax.core.Tracer) and np.isnan(array).any():
        raise ValueError(f"`{name}` must not be NaN; got {np.asarray(array).tolist()}.")
    return jnp.asarray(array, dtype)


def check_leading_axis(condition: Any, samples: int, name: str = "condition") -> None:
    """Raises `ValueError` unless every leaf of a condition has a leading axis of samples."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(condition):
        if jnp.ndim(leaf) == 0 or jnp.shape(leaf)[0] != samples:
            raise ValueError(
                f"every leaf of `{name}` must have a leading axis of {samples} samples; "
                f"got shape {jnp.shape(leaf)} at {name}{jax.tree_util.keystr(path)}. One condition for all samples is "
                "broadcast first: `jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (samples, *jnp.shape(leaf))), condition)`."
            )


def checked_drift(drift: Any, z: States) -> States:
    """The field's value, of the shape and in the type of the states: nothing is broadcast."""
    is_array = isinstance(drift, jax.Array | np.ndarray)
    if not is_array or not jnp.issubdtype(drift.dtype, jnp.floating):
        kind = drift.dtype if is_array else type(drift).__name__
        raise TypeError(f"`field` must return a floating-point array, dz/dtau; got {kind}.")
    if drift.shape != z.shape:
        raise ValueError(
            f"`field` must return dz/dtau of the shape of z, {z.shape}; got {drift.shape}."
        )
    return jnp.asarray(drift, z.dtype)
