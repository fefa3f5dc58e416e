"""What is said of a finished sample: whether every requirement holds, by how much, and if not, why."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


@dataclass(frozen=True)
class Certificate:
    """The verdict on one sample, made in float64 on the decoded object."""

    satisfied: bool
    min_margin: (
        float  # least margin of all requirements, in their units; negative where one is broken
    )
    violation: float  # V at the end
    draws: int  # initial samples tried, this one included
    reason: str | None  # which agent and which requirement, if not satisfied

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return asdict(self)


def certify(
    margins: Callable[[Float[Array, "agents dim"], Any], Float[Array, "agents requirements"]],
    z: Float[Array | np.ndarray, "agents dim"],
    condition: Any = None,
    *,
    buffer: float = 0.0,
    draws: int = 1,
    names: Sequence[str] | None = None,
) -> Certificate:
    """Evaluates margins h_ik (`>= 0`: satisfied) of a finished sample in float64.

    Args:
        margins: Requirement function, one row of margins per agent.
        z: Final state.
        condition: What the margins are conditioned on.
        buffer: Buffer of the hinge in the reported violation.
        draws: Number of initial samples tried so far.
        names: Names of the requirements, one per column, for the reason.
    """
    with jax.enable_x64(True):
        exact = jax.tree.map(_to_double, (np.asarray(z), condition))
        values = np.asarray(margins(*exact), np.float64)
    violation = float(np.sum(np.maximum(buffer - values, 0.0) ** 2) / 2)
    least = float(values.min())
    if least >= 0.0:
        return Certificate(True, least, violation, draws, None)
    agent, column = divmod(int(np.argmin(values)), values.shape[1])
    name = f"requirement {column}" if names is None else names[column]
    reason = f"agent {agent} misses {name} by {-least:.6g}"
    return Certificate(False, least, violation, draws, reason)


def _to_double(leaf: Any) -> Any:
    floating = isinstance(leaf, np.ndarray | jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)
    return jnp.asarray(np.asarray(leaf), jnp.float64) if floating else leaf
