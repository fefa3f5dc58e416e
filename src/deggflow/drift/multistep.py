"""Multistep methods: the field's last values, extrapolated along the next macro step."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from deggflow.shapes import Scalar, States
from deggflow.solver import Slope

from .base import MACRO_POWER, AbstractDrift, Interval, check_settings, macro_grid


class Differences(NamedTuple):
    """A polynomial in tau in Newton's form.

    Attributes:
        evaluations: How often the field has been evaluated.
        tau: Where it was evaluated last, the latest first.
        of_order: Divided differences of its values, order 0 first; zero while too few values are known.
    """

    evaluations: Int[Array, ""]
    tau: Float[Array, " order"]
    of_order: Float[Array, "order agents dim"]


@dataclass(frozen=True)
class AbstractMultistep(AbstractDrift):
    """A drift made of the field's last values, with one evaluation a macro step.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        order: Number of values that count; fewer in the first macro steps.
        power: Of `macro_grid`.
    """

    evaluations: int
    order: int
    power: float
    step_evaluations: ClassVar[int] = 1

    def __post_init__(self) -> None:
        check_settings(self.evaluations, self.power)
        if self.order not in (2, 3):
            raise ValueError(f"`order` must be 2 or 3; got {self.order}.")

    def field_evaluations(self, readings: Int[Array, "*samples"]) -> Int[Array, "*samples"]:
        """Those of the macro steps."""
        return jnp.full_like(readings, self.evaluations)


@dataclass(frozen=True)
class Extrapolated(AbstractMultistep):
    """The polynomial in tau through the field's last values, as in the Adams-Bashforth methods; of order 2 or 3.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        order: Number of values that the polynomial goes through; fewer in the first macro steps.
        power: Of `macro_grid`.
    """

    evaluations: int
    order: int = 2
    power: float = MACRO_POWER

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """As many steps as evaluations; with order 3 the first, which can only hold the field, is short."""
        if self.order == 2 or self.evaluations == 1:
            return macro_grid(self.evaluations, self.power)
        grid = macro_grid(self.evaluations - 1, self.power)
        # Holding the field along a step of length h^1.5 is off by O(h^3), as the steps of order 2 are.
        return np.insert(grid, 1, min(grid[1] ** 1.5, grid[1] / 2))

    def init(self, z0: States) -> Differences:
        """No values."""
        return no_values(self.order, z0)

    def step(
        self,
        field: Slope,
        state: Differences,
        interval: Interval,
        z: States,
    ) -> Differences:
        """The polynomial with one more value."""
        tau, _ = interval
        return with_value(state, tau, field(tau, z))

    def value(
        self,
        field: Slope,
        state: Differences,
        interval: Interval,
        tau: Scalar,
        z: States,
    ) -> States:
        """The polynomial's mean over the interval, by Gauss's two points, which are exact up to cubics."""
        middle, half = (interval[0] + interval[1]) / 2, (interval[1] - interval[0]) / 2

        def at(t: Scalar) -> States:
            value = state.of_order[-1]
            for order in reversed(range(self.order - 1)):
                value = value * (t - state.tau[order]) + state.of_order[order]
            return value

        return (at(middle - half / 3**0.5) + at(middle + half / 3**0.5)) / 2


def no_values(order: int, z0: States) -> Differences:
    """The polynomial before the first evaluation."""
    zeros = jnp.zeros((order, *z0.shape), z0.dtype)
    return Differences(jnp.zeros((), jnp.int32), jnp.zeros(order, z0.dtype), zeros)


def with_value(state: Differences, tau: Scalar, value: States) -> Differences:
    """The polynomial through one more value, without the oldest."""
    differences = [value]
    for order in range(1, len(state.of_order)):
        known = state.evaluations >= order
        span = jnp.where(known, tau - state.tau[order - 1], 1.0)
        change = (differences[-1] - state.of_order[order - 1]) / span
        differences.append(jnp.where(known, change, 0.0))
    before = jnp.concatenate([tau[None], state.tau[:-1]])
    return Differences(state.evaluations + 1, before, jnp.stack(differences))
