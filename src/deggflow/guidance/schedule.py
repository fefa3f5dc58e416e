"""omega(tau): when, over generative time, violations are brought down."""

import abc

import equinox as eqx

from deggflow.shapes import Scalar


class AbstractSchedule(eqx.Module):
    """A nonnegative weight on [0, 1] together with its integral up to tau = 1."""

    @abc.abstractmethod
    def __call__(self, tau: Scalar) -> Scalar:
        """omega(tau)."""

    @abc.abstractmethod
    def remaining(self, tau: Scalar) -> Scalar:
        """Integral of omega from tau to 1."""


class LinearSchedule(AbstractSchedule):
    """omega(tau) = start + slope tau (paper, Task 2: 0.1 + 1.8 tau, which integrates to one)."""

    start: float = 0.1
    slope: float = 1.8

    def __check_init__(self) -> None:
        if self.start < 0 or self.start + self.slope < 0:
            raise ValueError(
                "`start` and `start + slope` must not be negative, as omega >= 0 on [0, 1] "
                f"(paper, eqn:PE_rhs); got start = {self.start}, slope = {self.slope}."
            )

    def __call__(self, tau: Scalar) -> Scalar:
        return self.start + self.slope * tau

    def remaining(self, tau: Scalar) -> Scalar:
        return (1 - tau) * (self.start + self.slope * (1 + tau) / 2)


class PowerSchedule(AbstractSchedule):
    """omega(tau) = (power + 1) tau^power, which integrates to one: the later, the greater the power.

    Little is asked for while z is still noise, which the nominal field brings into order by itself.
    """

    power: float = 2.0

    def __check_init__(self) -> None:
        if not self.power >= 0:
            raise ValueError(
                "`power` must not be negative, as omega is finite on [0, 1] (paper, eqn:PE_rhs); "
                f"got {self.power}."
            )

    def __call__(self, tau: Scalar) -> Scalar:
        return (self.power + 1) * tau**self.power

    def remaining(self, tau: Scalar) -> Scalar:
        return 1 - tau ** (self.power + 1)
