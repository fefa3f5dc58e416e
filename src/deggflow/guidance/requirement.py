"""What a requirement is: half-spaces `ell @ u + b <= 0` for every agent it touches, and a verdict at the end.

A requirement says what it asks of each agent, and how the team may divide that. The same object judges the finished
sample.
"""

import abc
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States

from .margins import MarginLabel

Matrices = Float[Array, "agents dim inputs"] | Float[Array, "agents dim"]
"""g at one state: a matrix per agent, or the diagonal of one."""

Control = Matrices | None
"""g at one state; None: the identity."""

ControlMap = Callable[[Scalar, States, Any], Matrices]
"""g: (tau, z, condition) -> one matrix per agent, or its diagonal."""

MarginNames = Callable[[int, int, Sequence[str]], MarginLabel]
"""From a column of a row's margins, their number and the agents' names, what the column is."""


class Rows(NamedTuple):
    """Rows of every agent's local QP, one per factor of a requirement.

    Attributes:
        ell: g_i^T times the gradient in z_i, in requirement units per input unit.
        b: What the agent must bring down, positive where it must act.
        value: V or q, which measures how far the requirement is from being met.
        bound: What the theorem promises of the value at this tau.
        limit: The most that a discrete step may reach here and still lead to the required end.
        row_feasible: Whether the theorem's condition for a feasible row holds.
        rate: d value / d tau under the nominal field alone.
        contribution: How much each agent contributes to the value, in any unit.
        value_nan: Whether the requirement is not a number.
        gradient_nan: Whether its gradient is not a number.
    """

    ell: Float[Array, "rows agents inputs"]
    b: Float[Array, "rows agents"]
    value: Float[Array, " rows"]
    bound: Float[Array, " rows"]
    limit: Float[Array, " rows"]
    row_feasible: Bool[Array, "rows agents"]
    rate: Float[Array, " rows"]
    contribution: Float[Array, "rows agents"]
    value_nan: Bool[Array, "rows agents"]
    gradient_nan: Bool[Array, "rows agents"]


class Demand(NamedTuple):
    """What a requirement asks of the team at one state, before the agents share it.

    Attributes:
        ell: g_i^T grad_i of the value.
        rate: grad_i . f_i, the agent's part of d value / d tau under the nominal field.
        explicit_rate: Partial derivative of the value in tau.
        value: V or q.
        bound: What the theorem promises of the value at this tau.
        limit: The most that a discrete step may reach here and still lead to the required end.
        contribution: How much each agent contributes to the value, in any unit.
        value_nan: Whether the agent's part of the requirement is not a number.
        shares: zeta, what each agent is asked for, from |d|^2 of the rows' effective directions: what an agent can do
            about a row without making any other of its rows worse.
    """

    ell: Float[Array, "rows agents inputs"]
    rate: Float[Array, "rows agents"]
    explicit_rate: Float[Array, " rows"]
    value: Float[Array, " rows"]
    bound: Float[Array, " rows"]
    limit: Float[Array, " rows"]
    contribution: Float[Array, "rows agents"]
    value_nan: Bool[Array, "rows agents"]
    shares: Callable[[Float[Array, "rows agents"]], Float[Array, "rows agents"]]


class AbstractRequirement(eqx.Module):
    """Hard requirements that give each agent one row each, from states alone, and judge the sample in the end.

    Where a team is padded, `mask` is True for the agents that are present; None: all are. A requirement finds the
    mask for its own functions in the condition, or wherever the user keeps it.
    """

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """What reports call them, one name per row."""

    @abc.abstractmethod
    def init(self, z0: States, condition: Any, mask: Mask) -> Any:
        """State for one sample; bounds may depend on z(0)."""

    @abc.abstractmethod
    def values(self, tau: Scalar, z: States, condition: Any, mask: Mask) -> RowValues:
        """V or q of each row."""

    @abc.abstractmethod
    def margins_at_end(
        self, z: States, condition: Any, mask: Mask
    ) -> tuple[Float[Array, "..."], ...]:
        """The verdict: margins of z(1), nonnegative where a requirement holds, one array for each row.

        Shape (agents, margins) of a row that each agent has for itself, infinite where the agent is absent; shape ()
        of a row of the team. Called in float64.
        """

    @abc.abstractmethod
    def margin_names(self, row: int) -> MarginNames | None:
        """Names of the margins of a row, if they have names."""

    @abc.abstractmethod
    def demand(
        self,
        state: Any,
        tau: Scalar,
        z: States,
        drift: States,
        control: Control,
        condition: Any,
        moving: Mask = None,
    ) -> Demand:
        """What is asked at (tau, z), where the nominal field is `drift` and g is `control`.

        Agents that do not move (`moving` is False, and their drift is zero) can do nothing: their `ell` is zero.
        """

    @abc.abstractmethod
    def on_forced_step(self, state: Any, tau: Scalar, value: RowValues, above: RowFlags) -> Any:
        """The state after a step that was taken although it ended above a limit."""


def plain_number(value: Any) -> Any:
    """A number of Python in place of one of NumPy, which a static field can't hold."""
    return value.item() if isinstance(value, np.number) else value


def check_buffer(buffer: float, unit: str, aim: str) -> None:
    """Raises `ValueError` unless a buffer is a nonnegative finite number."""
    if not (isinstance(buffer, float | int) and 0 <= buffer < math.inf):
        raise ValueError(
            f"`buffer` must be a nonnegative finite number in the unit of {unit}, as guidance aims at {aim}; got {buffer!r}."
        )


def check_unrounded(what: str, value: Float[Array, "..."], z: States) -> None:
    """Raises `TypeError` if a requirement's function rounds its verdict to another type than that of the states."""
    if value.dtype != z.dtype:
        raise TypeError(
            f"{what} {value.dtype} for states of {z.dtype}: the verdict is made in float64, "
            "so the function must not round its result to another type."
        )


def input_gradient(
    control: Control, gradient: States, moving: Mask = None
) -> Float[Array, "agents inputs"]:
    """g_i^T gradient_i of every agent; zero for those that do not move."""
    if control is None:
        ell = gradient
    elif control.ndim == 2:
        ell = control * gradient
    else:
        ell = jnp.einsum("adm,ad->am", control, gradient)
    return ell if moving is None else jnp.where(moving[:, None], ell, 0.0)


def correction(control: Control, u: Float[Array, "agents inputs"]) -> States:
    """g_i u_i of every agent."""
    if control is None:
        return u
    return control * u if control.ndim == 2 else jnp.einsum("adm,am->ad", control, u)
