"""What a nominal drift is: made at the start of each macro step, read at every step of the guidance."""

import abc
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.shapes import Scalar, States
from deggflow.solver import Slope

Interval = tuple[Scalar, Scalar]
"""tau where a step begins and ends."""

MACRO_POWER = 1.5


def macro_grid(steps: int, power: float = MACRO_POWER) -> Float[np.ndarray, " points"]:
    """The points 1 - (1 - s)^power for equal steps of s: finer toward tau = 1; `power = 1` is uniform."""
    return 1 - (1 - np.linspace(0.0, 1.0, steps + 1)) ** power


class AbstractDrift(abc.ABC):
    """A nominal drift: made at the start of each macro step, read at every step of the guidance.

    Attributes:
        step_evaluations: Field evaluations at the start of a macro step; 0 if `step` evaluates no field.
    """

    step_evaluations: ClassVar[int]

    @property
    def nominal(self) -> "AbstractDrift":
        """What carries nominal samples to the same end, z at tau on the way."""
        return self

    def start(self, field: Slope, z0: States) -> States:
        """Where the guided generation begins: at z(0), unless the sample is predicted first."""
        return z0

    @abc.abstractmethod
    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """Where macro steps begin, and tau = 1."""

    @abc.abstractmethod
    def init(self, z0: States) -> Any:
        """States before the first macro step."""

    @abc.abstractmethod
    def step(self, field: Slope, state: Any, interval: Interval, z: States) -> Any:
        """States in the macro step on an interval that begins at z."""

    @abc.abstractmethod
    def value(self, field: Slope, state: Any, interval: Interval, tau: Scalar, z: States) -> States:
        """The drift at (tau, z), on a step of the guidance's grid."""

    @abc.abstractmethod
    def field_evaluations(self, readings: Int[Array, "*samples"]) -> Int[Array, "*samples"]:
        """Field evaluations of a generation in which `value` was read so often."""


def aligned(
    grid: Float[Array, " points"], macro: Float[np.ndarray, " macro_points"]
) -> tuple[Float[Array, " points"], Int[Array, " macro_steps"]]:
    """The guidance's grid with its nearest points moved onto a macro grid, and the indices where macro steps begin.

    No step of the guidance then crosses the start of a macro step, and the number of points stays.

    Raises:
        ValueError: There are more macro steps than steps.
    """
    inner, steps = macro[1:-1], len(grid) - 1
    if len(inner) >= steps:
        raise ValueError(
            f"`grid` must have at least as many steps as `drift` has macro steps, {len(inner) + 1}; got {steps}."
        )
    if not len(inner):
        return grid, jnp.zeros(1, jnp.int32)
    ahead, moved = jnp.arange(len(inner)), jnp.asarray(inner, grid.dtype)
    nearest = jnp.argmin(jnp.abs(grid[None] - moved[:, None]), axis=1)
    # Where the grid is the coarser one, several have the same nearest point: each takes one of its own.
    free = jnp.clip(jax.lax.cummax(nearest - ahead), 1, steps - len(inner))
    index = (free + ahead).astype(jnp.int32)
    return grid.at[index].set(moved), jnp.concatenate([jnp.zeros(1, jnp.int32), index])


def check_settings(evaluations: int, power: float) -> None:
    """Raises `ValueError` for settings that no drift takes."""
    if not isinstance(evaluations, int) or evaluations < 1:
        raise ValueError(f"`evaluations` must be a positive number; got {evaluations!r}.")
    if not power > 0:
        raise ValueError(
            f"`power` must be positive, else the grid does not reach tau = 1; got {power}."
        )
