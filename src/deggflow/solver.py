"""Explicit Runge-Kutta steps, by which generation goes from one value of tau to the next."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import add

from jaxtyping import Array, Float

State = Float[Array, "agents dim"]
Slope = Callable[[Float[Array, ""], State], State]


@dataclass(frozen=True)
class RungeKutta:
    """An explicit scheme by its Butcher tableau.

    Attributes:
        name: Of the scheme.
        nodes: c_2, c_3, ...
        stages: a_2, a_3, ...
        weights: b.
    """

    name: str
    nodes: tuple[float, ...]
    stages: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]

    def step(
        self, slope: Slope, tau: Float[Array, ""], z: State, first: State, size: Float[Array, ""]
    ) -> State:
        """The state after one step.

        Args:
            slope: dz/dtau.
            tau: Where the step begins.
            z: State there.
            first: dz/dtau there, which the caller knows already.
            size: Length of the step in tau.
        """
        slopes = [first]
        for node, row in zip(self.nodes, self.stages, strict=True):
            slopes.append(slope(tau + node * size, z + size * _combined(row, slopes)))
        return z + size * _combined(self.weights, slopes)


def _combined(weights: tuple[float, ...], slopes: list[State]) -> State:
    terms = [k if w == 1 else w * k for w, k in zip(weights, slopes, strict=True) if w]
    return reduce(add, terms)


EULER = RungeKutta("Euler", (), (), (1.0,))
HEUN = RungeKutta("Heun", (1.0,), ((1.0,),), (0.5, 0.5))
RK4 = RungeKutta(
    "RK4",
    (0.5, 0.5, 1.0),
    ((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    (1 / 6, 1 / 3, 1 / 3, 1 / 6),
)
