"""The field itself, or one value of it held along each macro step."""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.shapes import Scalar, States
from deggflow.solver import Slope

from .base import MACRO_POWER, AbstractDrift, Interval, check_settings, macro_grid


@dataclass(frozen=True)
class EveryStep(AbstractDrift):
    """The field itself, evaluated wherever the guidance is."""

    step_evaluations: ClassVar[int] = 0

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """One macro step."""
        return np.array([0.0, 1.0])

    def init(self, z0: States) -> None:
        """Nothing."""

    def step(self, field: Slope, state: None, interval: Interval, z: States) -> None:
        """Nothing."""

    def value(
        self, field: Slope, state: None, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """The field."""
        return field(tau, z)

    def field_evaluations(self, readings: Int[Array, "*samples"]) -> Int[Array, "*samples"]:
        """One each."""
        return readings


@dataclass(frozen=True)
class _AbstractHeld(AbstractDrift):
    """One value, made at the start of the macro step and held along it."""

    evaluations: int
    power: float = MACRO_POWER

    def __post_init__(self) -> None:
        check_settings(self.evaluations, self.power)

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """As many steps as there are evaluations for."""
        return macro_grid(self.evaluations // self.step_evaluations, self.power)

    def init(self, z0: States) -> States:
        """Zero, which is never read."""
        return jnp.zeros_like(z0)

    def value(
        self, field: Slope, state: States, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """The value held."""
        return state

    def field_evaluations(self, readings: Int[Array, "*samples"]) -> Int[Array, "*samples"]:
        """Those of the macro steps."""
        return jnp.full_like(readings, self.evaluations)


@dataclass(frozen=True)
class Held(_AbstractHeld):
    """The field's value at the start of the macro step; of order 1.

    With `evaluations=1` this is a one-step model: a field whose value at tau = 0 is the mean velocity up to tau = 1.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        power: Of `macro_grid`.
    """

    step_evaluations: ClassVar[int] = 1

    def step(self, field: Slope, state: States, interval: Interval, z: States) -> States:
        """The field's value."""
        return field(interval[0], z)


@dataclass(frozen=True)
class Midpoint(_AbstractHeld):
    """The field's value in the middle of the macro step, at a state predicted without guidance; of order 2.

    Attributes:
        evaluations: Field evaluations in all, two for each macro step.
        power: Of `macro_grid`.
    """

    step_evaluations: ClassVar[int] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.evaluations % 2:
            raise ValueError(
                f"`evaluations` must be even, as each step takes two; got {self.evaluations}."
            )

    def step(self, field: Slope, state: States, interval: Interval, z: States) -> States:
        """The field's value in the middle."""
        tau, end = interval
        half = (end - tau) / 2
        return field(tau + half, z + half * field(tau, z))


EVERY_STEP = EveryStep()
