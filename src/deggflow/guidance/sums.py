"""Several requirements with one V: each margin is measured in the buffer of its own requirement."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.shapes import AgentValues, Mask, States

from .margins import (
    AbstractMargins,
    AbstractNamedMargins,
    Dependence,
    FunctionMargins,
    MarginLabel,
    Pairs,
)


class SumOfMargins(AbstractNamedMargins):
    """The margins of several requirements, side by side.

    V_j = buffer^2 sum_p V_{p,j} / buffer_p^2, so V at most buffer^2 / 2 implies every margin of every part. Parts have
    equally many columns; infinite margins fill them up.

    Attributes:
        parts: Margins of each requirement.
        buffers: Its buffer, positive, in the unit of its margins.
        labels: Names of its columns, for parts that cannot name them; empty: no names.
    """

    parts: tuple[AbstractMargins, ...]
    buffers: tuple[float, ...] = eqx.field(static=True)
    labels: tuple[tuple[str, ...], ...] = eqx.field(static=True)

    def __check_init__(self) -> None:
        if not all(buffer > 0 for buffer in self.buffers):
            raise ValueError(
                f"`buffer` of each requirement of a sum must be positive, as its margins are measured in it; got {self.buffers}."
            )

    @classmethod
    def of(cls, one: "SumOfMargins", other: "SumOfMargins") -> "SumOfMargins":
        """All parts of two sums."""
        return cls(one.parts + other.parts, one.buffers + other.buffers, one.labels + other.labels)

    def masked(self, mask: Mask) -> "SumOfMargins":
        return SumOfMargins(
            tuple(_masked(part, mask) for part in self.parts), self.buffers, self.labels
        )

    def label(self, column: int, columns: int, agents: Sequence[str]) -> MarginLabel:
        width = columns // len(self.parts)
        k, own = divmod(column, width)
        part, labels = self.parts[k], self.labels[k]
        if isinstance(part, AbstractNamedMargins):
            return part.label(own, width, agents)
        return MarginLabel(labels[own] if labels else "", "")

    def __call__(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """All margins, each in its own unit."""
        margins = [part(z, condition) for part in self.parts]
        width = max(each.shape[1] for each in margins)
        filled = [
            jnp.pad(each, ((0, 0), (0, width - each.shape[1])), constant_values=jnp.inf)
            for each in margins
        ]
        return jnp.concatenate(filled, axis=1)

    def violation(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j of each agent, in the squared unit of `buffer`."""
        values = jnp.zeros(len(z), z.dtype)
        for part, own in zip(self.parts, self.buffers, strict=True):
            values = values + (buffer / own) ** 2 * part.violation(z, condition, own)
        return values

    def violation_and_gradient(
        self, z: States, condition: Any, buffer: float
    ) -> tuple[AgentValues, States]:
        """V_j of each agent, and the gradient of their sum."""
        values, gradient = jnp.zeros(len(z), z.dtype), jnp.zeros_like(z)
        for part, own in zip(self.parts, self.buffers, strict=True):
            value, slope = part.violation_and_gradient(z, condition, own)
            values = values + (buffer / own) ** 2 * value
            gradient = gradient + (buffer / own) ** 2 * slope
        return values, gradient

    def dependence(self, z: States, condition: Any, buffer: float) -> Dependence:
        """Which agents' states some part of V_j depends on now."""
        each = [
            part.dependence(z, condition, own)
            for part, own in zip(self.parts, self.buffers, strict=True)
        ]
        lists = [one for one in each if isinstance(one, Pairs)]
        tables = [one for one in each if not isinstance(one, Pairs)]
        if len(lists) == len(each):
            return Pairs(*(jnp.concatenate(parts) for parts in zip(*lists, strict=True)))
        whole = jnp.zeros((len(z), len(z)), bool)
        for table in tables:
            whole |= table
        for owner, agent, active in lists:
            whole = whole.at[owner, agent].max(active)
        return whole


def _masked(part: AbstractMargins, mask: Mask) -> AbstractMargins:
    if isinstance(part, AbstractNamedMargins):
        return part.masked(mask)
    if isinstance(part, FunctionMargins):
        return FunctionMargins(part.function, part.name, mask)
    return part
