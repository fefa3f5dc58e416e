"""How often the nominal field is evaluated: at every step of the guidance, or once or twice in each longer macro step.

The guarantees concern the drift that is integrated, whatever it is (docs/theory.md, section 3). Between two evaluations
of the field it may therefore be held or extrapolated, while guidance takes steps of its own. Along a step of the
guidance's grid an approximated drift is constant: the mean of the approximation over that step. The nominal part of the
path is then integrated exactly, and halving a step changes nothing about it.
"""

import abc
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .shapes import Scalar, States
from .solver import Slope

Interval = tuple[Scalar, Scalar]
"""tau where a step begins and ends."""

MACRO_POWER = 1.5


def macro_grid(steps: int, power: float = MACRO_POWER) -> Float[np.ndarray, " points"]:
    """The points 1 - (1 - s)^power for equal steps of s: finer toward tau = 1; `power = 1` is uniform."""
    return 1 - (1 - np.linspace(0.0, 1.0, steps + 1)) ** power


class AbstractDrift(abc.ABC):
    """A nominal drift: made at the start of each macro step, read at every step of the guidance.

    Attributes:
        step_evaluations: Field evaluations at the start of a macro step; 0 if `value` evaluates the field instead.
    """

    step_evaluations: ClassVar[int]

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


@dataclass(frozen=True)
class Held(AbstractDrift):
    """The field's value at the start of the macro step; of order 1.

    With `evaluations=1` this is a one-step model: a field whose value at tau = 0 is the mean velocity up to tau = 1.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        power: Of `macro_grid`.
    """

    evaluations: int
    power: float = MACRO_POWER
    step_evaluations: ClassVar[int] = 1

    def __post_init__(self) -> None:
        _check(self.evaluations, self.power)

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """As many steps as evaluations."""
        return macro_grid(self.evaluations, self.power)

    def init(self, z0: States) -> States:
        """Zero, which is never read."""
        return jnp.zeros_like(z0)

    def step(self, field: Slope, state: States, interval: Interval, z: States) -> States:
        """The field's value."""
        return field(interval[0], z)

    def value(
        self, field: Slope, state: States, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """The value held."""
        return state


@dataclass(frozen=True)
class Midpoint(AbstractDrift):
    """The field's value in the middle of the macro step, at a state predicted without guidance; of order 2.

    Attributes:
        evaluations: Field evaluations in all, two for each macro step.
        power: Of `macro_grid`.
    """

    evaluations: int
    power: float = MACRO_POWER
    step_evaluations: ClassVar[int] = 2

    def __post_init__(self) -> None:
        _check(self.evaluations, self.power)
        if self.evaluations % 2:
            raise ValueError(
                f"`evaluations` must be even, as each step takes two; got {self.evaluations}."
            )

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """Half as many steps as evaluations."""
        return macro_grid(self.evaluations // 2, self.power)

    def init(self, z0: States) -> States:
        """Zero, which is never read."""
        return jnp.zeros_like(z0)

    def step(self, field: Slope, state: States, interval: Interval, z: States) -> States:
        """The field's value in the middle."""
        tau, end = interval
        half = (end - tau) / 2
        return field(tau + half, z + half * field(tau, z))

    def value(
        self, field: Slope, state: States, interval: Interval, tau: Scalar, z: States
    ) -> States:
        """The value held."""
        return state


class _Differences(NamedTuple):
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
class Extrapolated(AbstractDrift):
    """The polynomial in tau through the field's last values, as in the Adams-Bashforth methods; of order 2 or 3.

    Attributes:
        evaluations: Field evaluations in all, one for each macro step.
        order: Number of values that the polynomial goes through; fewer in the first macro steps.
        power: Of `macro_grid`.
    """

    evaluations: int
    order: int = 2
    power: float = MACRO_POWER
    step_evaluations: ClassVar[int] = 1

    def __post_init__(self) -> None:
        _check(self.evaluations, self.power)
        if self.order not in (2, 3):
            raise ValueError(f"`order` must be 2 or 3; got {self.order}.")

    def macro_grid(self) -> Float[np.ndarray, " points"]:
        """As many steps as evaluations; with order 3 the first, which can only hold the field, is short."""
        if self.order == 2 or self.evaluations == 1:
            return macro_grid(self.evaluations, self.power)
        grid = macro_grid(self.evaluations - 1, self.power)
        # Holding the field along a step of length h^1.5 is off by O(h^3), as the steps of order 2 are.
        return np.insert(grid, 1, min(grid[1] ** 1.5, grid[1] / 2))

    def init(self, z0: States) -> _Differences:
        """No values."""
        zeros = jnp.zeros((self.order, *z0.shape), z0.dtype)
        return _Differences(jnp.zeros((), jnp.int32), jnp.zeros(self.order, z0.dtype), zeros)

    def step(
        self,
        field: Slope,
        state: _Differences,
        interval: Interval,
        z: States,
    ) -> _Differences:
        """The polynomial with one more value."""
        tau, _ = interval
        differences = [field(tau, z)]
        for order in range(1, self.order):
            known = state.evaluations >= order
            span = jnp.where(known, tau - state.tau[order - 1], 1.0)
            change = (differences[-1] - state.of_order[order - 1]) / span
            differences.append(jnp.where(known, change, 0.0))
        before = jnp.concatenate([tau[None], state.tau[:-1]])
        return _Differences(state.evaluations + 1, before, jnp.stack(differences))

    def value(
        self,
        field: Slope,
        state: _Differences,
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


EVERY_STEP = EveryStep()


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


def _check(evaluations: int, power: float) -> None:
    if not isinstance(evaluations, int) or evaluations < 1:
        raise ValueError(f"`evaluations` must be a positive number; got {evaluations!r}.")
    if not power > 0:
        raise ValueError(
            f"`power` must be positive, else the grid does not reach tau = 1; got {power}."
        )
