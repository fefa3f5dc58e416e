"""Temporal logic over the waypoints of a trajectory: always, eventually, until, and, or.

A formula has a robustness at each waypoint, in m, nonnegative where it holds (Donze and Maler, 2010). Guidance uses smooth
minima and maxima that are never above the exact ones, so that what it reaches holds; the verdict uses the exact ones.
"""

import abc
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import associative_scan, cumlogsumexp
from jax.nn import logsumexp
from jaxtyping import Array, Bool, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import AgentValues, States

from .layout import Layout
from .regions import AbstractRegion, as_region
from .smooth import maximum_below, minimum_below
from .term import AbstractOwnTerm, hinge
from .values import Value, check_nonnegative, is_constant, resolve

Signal = Float[Array, "agents waypoints"]
Window = tuple[int, int | None]
Exact = Callable[..., Array]
"""A minimum or maximum along an axis."""
Smooth = Callable[..., Array]
"""The same, smooth and below it by at most a width."""
FAR = 1e6  # m, beyond any robustness: what is not in a window


class AbstractFormula(eqx.Module):
    """What each agent's trajectory satisfies, from each waypoint on."""

    @abc.abstractmethod
    def robustness(self, x: Float[Array, "axes agents waypoints"], condition: Any) -> Signal:
        """Exact, by minima and maxima."""

    @abc.abstractmethod
    def bound(
        self, x: Float[Array, "axes agents waypoints"], condition: Any, width: float
    ) -> Signal:
        """Smooth, negative wherever the robustness is; by minima and maxima that are each too small by at most `width`."""

    def __and__(self, other: "AbstractFormula") -> "AbstractFormula":
        return Both(self, other)

    def __or__(self, other: "AbstractFormula") -> "AbstractFormula":
        return Either(self, other)


class _AbstractPlace(AbstractFormula):
    """Where a waypoint is, relative to convex regions.

    Attributes:
        region: Regions.
        radius: Of the agents, in m.
    """

    region: Value | AbstractRegion
    radius: float = 0.0

    def __check_init__(self) -> None:
        check_nonnegative("radius", self.radius, "of the agents")
        if np.ndim(self.radius):
            raise ValueError(f"`radius` must be one number, of all agents; got {self.radius!r}.")
        if is_constant(self.region):
            as_region(self.region)

    @abc.abstractmethod
    def _exact(self, region: AbstractRegion, x: Float[Array, "axes agents waypoints"]) -> Signal:
        """The robustness of points."""

    @abc.abstractmethod
    def _smooth(self, faces: Array, width: float) -> Signal:
        """A bound below it, from the signed distances of the regions' faces."""

    def robustness(self, x: Float[Array, "axes agents waypoints"], condition: Any) -> Signal:
        return self._exact(as_region(resolve(self.region, condition, x.dtype)), x) - self.radius

    def bound(
        self, x: Float[Array, "axes agents waypoints"], condition: Any, width: float
    ) -> Signal:
        faces = as_region(resolve(self.region, condition, x.dtype)).faces(x)
        return self._smooth(faces, width) - self.radius


class Within(_AbstractPlace):
    """The waypoint is inside one of several convex regions, with a radius.

    Attributes:
        region: Regions.
        radius: Of the agents, in m.
    """

    def _exact(self, region: AbstractRegion, x: Float[Array, "axes agents waypoints"]) -> Signal:
        return jnp.max(region.depth(x), axis=0)

    def _smooth(self, faces: Array, width: float) -> Signal:
        # The depth inside; outside, of the same sign.
        return maximum_below(minimum_below(faces, width, axis=0), width, axis=0)


class Without(_AbstractPlace):
    """The waypoint is outside of convex regions, with a radius.

    Attributes:
        region: Regions.
        radius: Of the agents, in m.
    """

    def _exact(self, region: AbstractRegion, x: Float[Array, "axes agents waypoints"]) -> Signal:
        return jnp.min(region.clearance(x, False), axis=0)

    def _smooth(self, faces: Array, width: float) -> Signal:
        # The gap beyond the farthest face is at most the distance.
        return minimum_below(maximum_below(-faces, width, axis=0), width, axis=0)


class _AbstractPair(AbstractFormula):
    """Two formulas and what is made of their robustness."""

    one: AbstractFormula
    other: AbstractFormula

    def __check_init__(self) -> None:
        _check_formulas(one=self.one, other=self.other)

    combination: eqx.AbstractClassVar[tuple[Exact, Smooth]]
    """Exact, and smooth below it."""

    def robustness(self, x: Float[Array, "axes agents waypoints"], condition: Any) -> Signal:
        exact, _ = self.combination
        parts = [each.robustness(x, condition) for each in (self.one, self.other)]
        return exact(jnp.stack(parts), axis=0)

    def bound(
        self, x: Float[Array, "axes agents waypoints"], condition: Any, width: float
    ) -> Signal:
        _, smooth = self.combination
        parts = [each.bound(x, condition, width) for each in (self.one, self.other)]
        return smooth(jnp.stack(parts), width, axis=0)


class Both(_AbstractPair):
    """Both of two formulas.

    Attributes:
        one: A formula.
        other: Another.
    """

    combination: ClassVar[tuple[Exact, Smooth]] = jnp.min, minimum_below


class Either(_AbstractPair):
    """At least one of two formulas.

    Attributes:
        one: A formula.
        other: Another.
    """

    combination: ClassVar[tuple[Exact, Smooth]] = jnp.max, maximum_below


class _AbstractWindowed(AbstractFormula):
    """A formula along a window of waypoints and what is made of its robustness there."""

    inner: AbstractFormula
    window: Window = eqx.field(static=True, default=(0, None))

    def __check_init__(self) -> None:
        _check_formulas(inner=self.inner)
        _check_window(self.window)

    combination: eqx.AbstractClassVar[tuple[Exact, Smooth, float]]
    """Exact, smooth below it, and what waypoints outside of the window count as."""

    def robustness(self, x: Float[Array, "axes agents waypoints"], condition: Any) -> Signal:
        exact, _, beyond = self.combination
        inner = self.inner.robustness(x, condition)[:, None]
        return exact(jnp.where(_seen(self.window, x), inner, beyond), axis=2)

    def bound(
        self, x: Float[Array, "axes agents waypoints"], condition: Any, width: float
    ) -> Signal:
        _, smooth, beyond = self.combination
        inner = self.inner.bound(x, condition, width)[:, None]
        return smooth(jnp.where(_seen(self.window, x), inner, beyond), width, axis=2)


class Always(_AbstractWindowed):
    """A formula holds at all waypoints of a window.

    Attributes:
        inner: The formula.
        window: First and last waypoint, counted from the present one; None: to the end. What is beyond the end does not
            count.
    """

    combination: ClassVar[tuple[Exact, Smooth, float]] = jnp.min, minimum_below, FAR


class Eventually(_AbstractWindowed):
    """A formula holds at some waypoint of a window.

    Attributes:
        inner: The formula.
        window: As of `Always`; from a waypoint at which all of it is beyond the end, the formula fails.
    """

    combination: ClassVar[tuple[Exact, Smooth, float]] = jnp.max, maximum_below, -FAR


class Until(AbstractFormula):
    """A formula holds at all waypoints up to one of a window, at which another one holds.

    Attributes:
        before: What holds from the present waypoint on, up to and including that one.
        then: What holds there.
        window: As of `Eventually`.
    """

    before: AbstractFormula
    then: AbstractFormula
    window: Window = eqx.field(static=True, default=(0, None))

    def __check_init__(self) -> None:
        _check_formulas(before=self.before, then=self.then)
        _check_window(self.window)

    def robustness(self, x: Float[Array, "axes agents waypoints"], condition: Any) -> Signal:
        first = jnp.where(_seen((0, None), x), self.before.robustness(x, condition)[:, None], FAR)
        held = associative_scan(jnp.minimum, first, axis=2)
        both = jnp.minimum(held, self.then.robustness(x, condition)[:, None])
        return jnp.max(jnp.where(_seen(self.window, x), both, -FAR), axis=2)

    def bound(
        self, x: Float[Array, "axes agents waypoints"], condition: Any, width: float
    ) -> Signal:
        sharpness = math.log(max(x.shape[2], 2)) / width
        first = jnp.where(_seen((0, None), x), self.before.bound(x, condition, width)[:, None], FAR)
        held = -cumlogsumexp(-sharpness * first, axis=2) / sharpness
        then = self.then.bound(x, condition, width)[:, None]
        both = -logsumexp(
            jnp.stack([-sharpness * held, jnp.broadcast_to(-sharpness * then, held.shape)]), axis=0
        )
        return maximum_below(jnp.where(_seen(self.window, x), both / sharpness, -FAR), width, 2)


def _check_formulas(**formulas: Any) -> None:
    for name, formula in formulas.items():
        if not isinstance(formula, AbstractFormula):
            raise TypeError(
                f"`{name}` must be a formula, made of `Within`, `Always`, ...; got {formula!r}."
            )


def _check_window(window: Any) -> None:
    if not (isinstance(window, tuple) and len(window) == 2 and isinstance(window[0], int)
            and (window[1] is None or isinstance(window[1], int))
            and 0 <= window[0] <= (window[0] if window[1] is None else window[1])):  # fmt: skip
        raise ValueError(
            f"`window` must be a first and a last waypoint, such as (0, 3) or (2, None); got {window!r}."
        )


def _seen(
    window: Window, x: Float[Array, "axes agents waypoints"]
) -> Bool[np.ndarray, "1 now later"]:
    """Which waypoints are in the window of which."""
    ahead = np.arange(x.shape[2])[None] - np.arange(x.shape[2])[:, None]
    last = x.shape[2] if window[1] is None else window[1]
    return ((ahead >= window[0]) & (ahead <= last))[None]


class Satisfied(AbstractOwnTerm):
    """The robustness of a formula from the first waypoint on, in m.

    Attributes:
        formula: Of each agent.
    """

    formula: AbstractFormula

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        return self.formula.robustness(self.layout.positions(z, condition), condition)[:, :1]

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        x = self.layout.positions(z, condition)
        if buffer == 0:  # nothing to smooth over
            return hinge(-self.formula.robustness(x, condition)[:, 0])
        return hinge(buffer - self.formula.bound(x, condition, WIDTH * buffer)[:, 0])

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel("robustness", self.layout.unit)


WIDTH = 0.25  # of a buffer: the narrower, the fewer waypoints guidance moves at once


def satisfies(
    formula: AbstractFormula, *, layout: Layout, buffer: float = 0.01, name: str = "formula"
) -> PrivateRequirement:
    """Each agent's trajectory satisfies a formula of temporal logic, at its waypoints.

    Args:
        formula: Made of `Within`, `Without`, `Always`, `Eventually`, `Until`, `&` and `|`.
        layout: Of trajectories.
        buffer: Robustness that guidance aims at, in m.
        name: What certificates call it.

    Example:
        >>> visit = Eventually(Within(Disc((1.0, 0.0), 0.5)))
        >>> z = jnp.array([[0.0, 0.0, 1.0, 0.25, 2.0, 0.0]])
        >>> satisfies(visit, layout=trajectories(3)).margins(z, None)
        Array([[0.25]], dtype=float32)
    """
    if not isinstance(formula, AbstractFormula):
        raise TypeError(f"`formula` must be made of `Within`, `Always`, ...; got {formula!r}.")
    return PrivateRequirement(Satisfied(formula, layout=layout), buffer, name=name)
