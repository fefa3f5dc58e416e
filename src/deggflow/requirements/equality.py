"""Equations: one violation g^2 / 2, and a last step that solves them to rounding."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.guidance import MarginLabel, PrivateRequirement
from deggflow.shapes import AgentValues, States

from .term import AbstractTerm

Equations = Callable[[States, Any], Float[Array, "agents equations"]]
"""g: (z, condition) -> one row for each agent, zero where they hold."""


class Equality(AbstractTerm):
    """A tolerance less |g|, for V_j = sum_k g_jk^2 / 2, which at most tolerance^2 / 2 implies |g| <= tolerance.

    One V, not two shared factors +-g, whose rows would be opposed everywhere.

    Attributes:
        function: g.
        tolerance: In the unit of g.
        unit: Of g.
    """

    function: Equations
    tolerance: float = eqx.field(static=True)
    unit: str = eqx.field(static=True, default="")

    def _values(self, z: States, condition: Any) -> Float[Array, "agents equations"]:
        g = self.function(z, condition)
        if jnp.ndim(g) != 2 or g.shape[0] != len(z):
            raise ValueError(
                f"`g` must return shape (agents, equations), one row for each of {len(z)} agents; got {jnp.shape(g)}."
            )
        return g

    def exact(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        return self.tolerance - jnp.abs(self._values(z, condition))

    def hinges(self, z: States, condition: Any, buffer: float) -> AgentValues:
        return jnp.sum(self._values(z, condition) ** 2, axis=1) / 2

    def active(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        slopes = jax.jacrev(lambda z: self.violation(z, condition, buffer))(z)
        return jnp.any(slopes != 0, axis=-1)

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        return MarginLabel(f"equation {column}" if columns > 1 else "", self.unit)


def equal(
    g: Equations, tolerance: float, *, unit: str = "", name: str = "equal"
) -> PrivateRequirement:
    """Equations g = 0 of each agent, to a tolerance.

    Args:
        g: (z, condition) -> (agents, equations), smooth, with a gradient where it is zero.
        tolerance: Largest |g|, in its unit; it is the buffer, too.
        unit: Of g.
        name: What certificates call it.

    Raises:
        ValueError: `tolerance` is not positive: `solve` brings g to zero up to rounding.

    Example:
        >>> ring = equal(lambda z, _: jnp.sum(z**2, axis=1, keepdims=True) - 1.0, 0.25)
        >>> ring.margins(jnp.array([[0.5, 0.0]]), None)
        Array([[-0.5]], dtype=float32)
    """
    if not tolerance > 0:
        raise ValueError(
            f"`tolerance` must be positive, as guidance approaches g = 0 in finitely many steps; got {tolerance}: "
            "`requirements.solve` brings g to zero up to rounding."
        )
    return PrivateRequirement(Equality(g, tolerance, unit), tolerance, name=name)


class Solution(NamedTuple):
    """States after the last step.

    Attributes:
        z: In float64, shape (samples, agents, dim).
        residual: Largest |g| of each sample.
        moved: How far each sample's agents were moved at most, in the unit of z.
    """

    z: Float[np.ndarray, "samples agents dim"]
    residual: Float[np.ndarray, " samples"]
    moved: Float[np.ndarray, " samples"]


def solve(
    z: Float[Array | np.ndarray, "samples agents dim"], g: Equations, condition: Any = None
) -> Solution:
    """Moves finished samples onto g = 0 in float64 by Gauss-Newton steps of least norm, until they change nothing.

    The states that result are other than the generated ones: certify them by `deggflow.verdicts`, of all requirements.

    Args:
        z: Finished samples, close to g = 0.
        g: Equations, as of `equal`.
        condition: One for all samples.

    Example:
        >>> ring = lambda z, _: jnp.sum(z**2, axis=1, keepdims=True) - 1.0
        >>> bool(solve(np.full((1, 3, 2), 0.7), ring).residual < 1e-15)
        True
    """

    def step(z: States) -> States:
        value, pull_back = jax.vjp(lambda z: g(z, condition).ravel(), z)
        jacobian = jax.vmap(pull_back)(jnp.eye(len(value), dtype=z.dtype))[0]
        rows = jacobian.reshape(len(value), -1)
        change = jnp.linalg.lstsq(rows, value)[0]
        return z - change.reshape(z.shape)

    def one(z: States) -> tuple[States, Array]:
        def better(state: tuple[Array, Array, Array]) -> Array:
            return state[2]

        def improve(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            z, residual, _ = state
            new = step(z)
            least = jnp.max(jnp.abs(g(new, condition)))
            closer = least < residual
            return jnp.where(closer, new, z), jnp.where(closer, least, residual), closer

        start = z, jnp.max(jnp.abs(g(z, condition))), jnp.asarray(True)
        return jax.lax.while_loop(better, improve, start)[:2]

    with jax.enable_x64(True):
        start = np.asarray(z, np.float64)
        end, residual = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(start))
    distance = np.linalg.norm(end - start, axis=-1).max(axis=-1)
    return Solution(end, residual, distance)
