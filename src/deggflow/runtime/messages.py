"""What an agent of a team says of one point: its state, and what acceptance and certificate need of it.

A message has the fields of `AgentMessage` and a fixed length. None of them can hold an input, a drift or a velocity.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class AgentMessage(NamedTuple):
    """One agent's message in one round, about the point at which the whole team is.

    `tau` and `z` are what the others' inputs depend on. `value` and `limit` are compared for the acceptance of the
    point. All other fields are for the record, and change neither a state nor a decision.

    Attributes:
        tau: Of the state that the agent proposes next; 1 where nothing follows.
        z: That state.
        value: V or q of each requirement at the present point, as the agent evaluates it from the states it was told.
        limit: The most that the value may be.
        contribution: How much the agent contributes to the value.
        ell_norm: |ell| where the agent must act, else infinite.
        opposed_sine: Least sine between two opposed rows of the agent; 1 without such rows.
        input_norm: Euclidean length of its input.
        active: Whether the row decides its input.
        row_feasible: Whether the theorem's condition for a feasible row holds.
        qp_infeasible: Whether no input meets all of its rows.
        drift_nan: Whether its drift is not finite.
        value_nan: Whether its part of the requirement is not a number.
        gradient_nan: Whether the gradient is not a number.
        input_nan: Whether its input is not a number.
        last: Whether the agent has accepted tau = 1.
    """

    tau: Float[np.ndarray, ""]
    z: Float[np.ndarray, " dim"]
    value: Float[np.ndarray, " rows"]
    limit: Float[np.ndarray, " rows"]
    contribution: Float[np.ndarray, " rows"]
    ell_norm: Float[np.ndarray, " rows"]
    opposed_sine: Float[np.ndarray, ""]
    input_norm: Float[np.ndarray, ""]
    active: Bool[np.ndarray, " rows"]
    row_feasible: Bool[np.ndarray, " rows"]
    qp_infeasible: Bool[np.ndarray, ""]
    drift_nan: Bool[np.ndarray, ""]
    value_nan: Bool[np.ndarray, " rows"]
    gradient_nan: Bool[np.ndarray, " rows"]
    input_nan: Bool[np.ndarray, ""]
    last: Bool[np.ndarray, ""]


PER_ROW = ("value", "limit", "contribution", "ell_norm", "active", "row_feasible", "value_nan", "gradient_nan")  # fmt: skip
NUMBERS = ("tau", "z", "value", "limit", "contribution", "ell_norm", "opposed_sine", "input_norm")
RECORD_ONLY = AgentMessage._fields[4:-1]
"""Fields that no agent's state and no decision depends on."""


class Layout:
    """The bytes of a message: its fields one after another, numbers little-endian in the type of the states.

    Attributes:
        fields: The structured type, with one named field for each of `AgentMessage`.

    Example:
        >>> from deggflow.runtime import Layout
        >>> Layout(dim=3, rows=1, dtype="float32").size
        48
    """

    def __init__(self, *, dim: int, rows: int, dtype: Any) -> None:
        """Args: dim: entries of one agent's state; rows: of the requirements; dtype: of the states."""
        number = np.dtype(dtype).newbyteorder("<")
        self.fields = np.dtype(
            [
                (name, number if name in NUMBERS else np.dtype("u1"), _shape(name, dim, rows))
                for name in AgentMessage._fields
            ]
        )

    @property
    def size(self) -> int:
        """Bytes of every message."""
        return self.fields.itemsize

    def encode(self, message: AgentMessage) -> bytes:
        """The bytes of a message.

        Raises:
            ValueError: A field has another shape than the layout's.
        """
        line = np.zeros((), self.fields)
        for name, value in zip(AgentMessage._fields, message, strict=True):
            entry = np.asarray(value)
            if entry.shape != self.fields[name].shape:
                raise ValueError(
                    f"`{name}` of a message must have shape {self.fields[name].shape}; got {entry.shape}."
                )
            line[name] = entry
        return line.tobytes()

    def decode(self, data: bytes) -> AgentMessage:
        """The message of these bytes.

        Raises:
            ValueError: They are not `size` bytes, or a flag is neither 0 nor 1.
        """
        if len(data) != self.size:
            raise ValueError(f"`data` must have the layout's {self.size} bytes; got {len(data)}.")
        line = np.frombuffer(data, self.fields)[0]
        for name in AgentMessage._fields:
            if name not in NUMBERS and np.any(line[name] > 1):
                raise ValueError(f"`{name}` of a message must be 0 or 1; got {line[name]}.")
        return AgentMessage(
            *(
                np.asarray(line[name], self.fields[name].base.newbyteorder("=") if name in NUMBERS else bool)
                for name in AgentMessage._fields
            )
        )  # fmt: skip

    def table(self) -> str:
        """Every field with its type, shape and bytes, one line each."""
        lines = []
        for name in AgentMessage._fields:
            field = self.fields[name]
            kind = f"{field.base.kind}{field.base.itemsize}"
            lines.append(f"{name:<14} {kind:<3} {field.shape!s:<5} {field.itemsize:>4}")
        return "\n".join([*lines, f"{'in all':<24} {self.size:>4}"])


def _shape(name: str, dim: int, rows: int) -> tuple[int, ...]:
    if name == "z":
        return (dim,)
    return (rows,) if name in PER_ROW else ()
