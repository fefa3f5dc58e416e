"""Inputs that move smooth parts of a path: control maps of few modes, and of all of them as tau grows."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.shapes import Scalar, States

from .layout import Layout


class SmoothModes(eqx.Module):
    """A control map g: inputs are amplitudes of the smoothest modes of a path, not single waypoints.

    A waypoint that moves alone leaves a rough path, and guidance with such inputs fails (docs/requirements.md). Modes
    vanish at ends that the layout holds, and an input of mode k moves the path k^decay times less than one of mode 1.

    Attributes:
        layout: Of trajectories.
        modes: How many, for each entry of a waypoint.
        decay: How much less later modes move: their weight is k^-decay.
        free: (tau, tau) between which all modes become available with equal weights, which is to say that every waypoint
            is free at the end; None: never.

    Example:
        >>> held = trajectories(64, start="start", goal="goal")
        >>> SmoothModes(held, 20)(jnp.zeros(()), jnp.zeros((5, 128)), None).shape
        (5, 128, 40)
    """

    layout: Layout
    modes: int = eqx.field(static=True, default=20)
    decay: float = eqx.field(static=True, default=1.0)
    free: tuple[float, float] | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        if not 1 <= self.modes <= self.degrees:
            raise ValueError(
                f"`modes` must be in [1, {self.degrees}], the waypoints that are not held; got {self.modes}."
            )
        if self.free is not None and not 0 <= self.free[0] < self.free[1] <= 1:
            raise ValueError(
                f"`free` must be two increasing values of tau in [0, 1]; got {self.free}."
            )

    @property
    def degrees(self) -> int:
        """Waypoints that are not held."""
        held = (self.layout.start is not None) + (self.layout.goal is not None)
        return self.layout.waypoints - held

    def basis(self) -> Float[np.ndarray, "waypoints modes"]:
        """Orthonormal modes, the smoothest first; zero at ends that are held."""
        count, start, goal = self.layout.waypoints, self.layout.start, self.layout.goal
        k = np.arange(self.degrees)
        if start is not None and goal is not None:
            table = np.sin(np.pi * np.outer(np.arange(count) / (count - 1), k + 1))
        elif start is None and goal is None:
            table = np.cos(np.pi * np.outer((np.arange(count) + 0.5) / count, k))
        else:
            # Odd about the end that is held, even half a step beyond the free one.
            table = np.sin(np.pi * np.outer(np.arange(count) / (count - 0.5), k + 0.5))
            table = table if start is not None else table[::-1]
        table = table / np.linalg.norm(table, axis=0)
        held = [0] * (start is not None) + [count - 1] * (goal is not None)
        table[held] = 0.0
        return table

    def __call__(self, tau: Scalar, z: States, condition: Any) -> Float[Array, "agents dim inputs"]:
        """One matrix for all agents."""
        entries = z.shape[1] // self.layout.waypoints
        k = np.arange(1, self.degrees + 1)
        weight = jnp.asarray(np.where(k <= self.modes, k**-self.decay, 0.0), z.dtype)
        table = self.basis()
        if self.free is None:
            weight, table = weight[: self.modes], table[:, : self.modes]
        else:
            s = jnp.clip((tau - self.free[0]) / (self.free[1] - self.free[0]), 0.0, 1.0)
            weight = weight + (1.0 - weight) * s * s * (3 - 2 * s)
        weighted = jnp.asarray(table, z.dtype) * weight[None]
        matrix = jnp.kron(weighted, jnp.eye(entries, dtype=z.dtype))
        return jnp.broadcast_to(matrix, (len(z), *matrix.shape))
