"""beta(tau): the bound under which a shared requirement is led to its end value."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from deggflow.shapes import Scalar

SLACK = 0.02  # by which the bound starts above q(z(0)) (paper, Task 1)


class AbstractBound(eqx.Module):
    """A C^1 bound with beta(0) >= q(z(0)); its derivative is taken automatically.

    `end(condition)` is beta(1), which is what the requirement promises of a finished sample: it must not depend on z(0).
    """

    end: eqx.AbstractVar[Callable[[Any], Scalar | float]]

    @abc.abstractmethod
    def init(self, value: Scalar, condition: Any) -> Any:
        """State of one sample, from q(0, z(0))."""

    @abc.abstractmethod
    def __call__(self, state: Any, tau: Scalar) -> Scalar:
        """beta(tau)."""


class Ends(NamedTuple):
    """Where a bound starts and where it leads.

    Attributes:
        start: beta(0).
        end: beta(1).
    """

    start: Scalar
    end: Scalar


def quintic(tau: Scalar) -> Scalar:
    """1 - 10 tau^3 + 15 tau^4 - 6 tau^5: from one to zero, flat at both ends to second order."""
    return 1 - tau**3 * (10 - tau * (15 - 6 * tau))


def zero(condition: Any) -> Scalar:
    """The end value of a plain hard requirement."""
    return jnp.zeros(())


class TighteningBound(AbstractBound):
    """beta(tau) = end + (start - end) profile(tau), start = max(q(z(0)) + slack, end + least).

    Args:
        end: End value from the condition; 0 by default.
        slack: Start above q(z(0)).
        least: Start at least this much above the end; None: the bound may also rise to its end.
        profile: From 1 at tau = 0 to 0 at tau = 1, continuously differentiable.

    Source: paper, App. on Task 1 (beta_a).
    """

    end: Callable[[Any], Scalar | float] = zero
    slack: float = eqx.field(static=True, default=SLACK)
    least: float | None = eqx.field(static=True, default=None)
    profile: Callable[[Scalar], Scalar] = quintic

    def __check_init__(self) -> None:
        if not self.slack >= 0:
            raise ValueError(
                f"`slack` must not be negative, else beta(0) < q(z(0)) (paper, eqn:SE_beta_start); got {self.slack}."
            )
        if not callable(self.end):
            raise TypeError(
                f"`end` must be a function of the condition, such as `lambda condition: 0.0`; got {self.end!r}."
            )
        if self.profile is quintic:
            return
        ends = [float(self.profile(jnp.asarray(tau))) for tau in (0.0, 1.0)]
        if not (abs(ends[0] - 1) < 1e-6 and abs(ends[1]) < 1e-6):
            raise ValueError(
                f"`profile` must fall from 1 at tau = 0 to 0 at tau = 1; got {ends[0]} and {ends[1]}."
            )

    def init(self, value: Scalar, condition: Any) -> Ends:
        end = jnp.asarray(self.end(condition), value.dtype).reshape(())
        start = value + self.slack
        return Ends(start if self.least is None else jnp.maximum(start, end + self.least), end)

    def __call__(self, state: Ends, tau: Scalar) -> Scalar:
        return state.end + (state.start - state.end) * self.profile(tau)
