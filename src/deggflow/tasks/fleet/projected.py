"""Baseline: the joint projection of a nominal plan onto the requirements, as MRMP does it.

Source: Liang et al., Simultaneous Multi-Robot Motion Planning with Projected Diffusion Models (RAISELab-atUVA/Diffusion-
MRMP), which projects with an augmented Lagrangian and IPOPT. Written anew: the augmented Lagrangian of Rockafellar (1973)
for inequalities, minimised by L-BFGS. A central solver must know every robot's path.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from deggflow.shapes import Scalar

from .condition import APART, FleetArrays, FleetCondition, padding, to_arrays
from .surroundings import surroundings

ROOM = 0.003  # map units, kept beyond what is required
OUTER, INNER = 12, 200  # updates of the multipliers, iterations of L-BFGS between them
PENALTY, GROWTH = 50.0, 3.0  # its first value, and factor after every update

Paths = Float[Array, "robots 64 2"]


class Projected(NamedTuple):
    """What the projection found.

    Attributes:
        paths: One per robot, in float64.
        iterations: Of L-BFGS in all.
        shortfall: Largest violation of a constraint, in map units; 0 where all hold.
    """

    paths: Float[np.ndarray, "robots 64 2"]
    iterations: int
    shortfall: float


def _margins(paths: Paths, c: FleetArrays) -> Float[Array, " constraints"]:
    """At least 0 where robots are apart and clear, at waypoints and between them, and within the speed limit."""
    step = jnp.diff(paths, axis=1)
    points = jnp.concatenate([paths, paths[:, :-1] + step / 2], axis=1)
    first, second = np.triu_indices(paths.shape[0], 1)
    gap = jnp.sqrt(jnp.sum((points[first] - points[second]) ** 2, axis=-1) + 1e-12)
    flat = points.reshape(-1, 2)
    distance, _, _ = surroundings(flat[:, 0], flat[:, 1], c)
    length = jnp.sqrt(jnp.sum(step**2, axis=-1) + 1e-12)
    parts = gap - APART * c.radius - ROOM, distance - c.radius - ROOM, 0.98 * c.speed_limit - length
    return jnp.concatenate([part.reshape(-1) for part in parts])


def _lagrangian(
    inner: Float[Array, " inner"],
    nominal: Paths,
    multipliers: Float[Array, " constraints"],
    penalty: Scalar,
    c: FleetArrays,
) -> Scalar:
    paths = _with_ends(inner, nominal)
    push = jnp.maximum(multipliers - penalty * _margins(paths, c), 0.0)
    return jnp.sum((paths - nominal) ** 2) / 2 + jnp.sum(push**2) / (2 * penalty)


def _with_ends(inner: Float[Array, " inner"], nominal: Paths) -> Paths:
    between = inner.reshape(nominal.shape[0], -1, 2).astype(nominal.dtype)
    return jnp.concatenate([nominal[:, :1], between, nominal[:, -1:]], axis=1)


class Projection:
    """Programs that are compiled once for each number of robots."""

    def __init__(self) -> None:
        """No arguments."""
        self._slope: Callable[..., tuple[Array, Array]] = jax.jit(jax.value_and_grad(_lagrangian))
        self._margins: Callable[..., Array] = jax.jit(_margins)

    def __call__(
        self, nominal: Float[np.ndarray, "robots 64 2"], condition: FleetCondition
    ) -> Projected:
        """The nearest plan, in the sum of squares over waypoints, that the augmented Lagrangian finds."""
        whole = to_arrays([condition], padding([condition]))
        c = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), whole)
        paths = jnp.asarray(nominal, jnp.float32)
        multipliers, penalty = jnp.zeros_like(self._margins(paths, c)), PENALTY
        inner, iterations, shortfall = np.asarray(nominal[:, 1:-1], float).ravel(), 0, np.inf
        for _ in range(OUTER):
            value = partial(self._value, paths, multipliers, penalty, c)
            result = minimize(value, inner, jac=True, method="L-BFGS-B", options={"maxiter": INNER})
            inner, iterations = result.x, iterations + result.nit
            margins = self._margins(_with_ends(jnp.asarray(inner), paths), c)
            shortfall = float(-jnp.min(margins))
            if shortfall <= ROOM / 3:
                break
            multipliers = jnp.maximum(multipliers - penalty * margins, 0.0)
            penalty *= GROWTH
        found = np.array(nominal, float)
        found[:, 1:-1] = inner.reshape(len(found), -1, 2)
        return Projected(found, iterations, max(shortfall - ROOM, 0.0))

    def _value(
        self,
        nominal: Paths,
        multipliers: Float[Array, " constraints"],
        penalty: float,
        c: FleetArrays,
        inner: Float[np.ndarray, " inner"],
    ) -> tuple[float, Float[np.ndarray, " inner"]]:
        value, slope = self._slope(
            jnp.asarray(inner, jnp.float32), nominal, multipliers, penalty, c
        )
        return float(value), np.asarray(slope, float)
