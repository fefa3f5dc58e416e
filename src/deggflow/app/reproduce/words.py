"""Rates and numbers as text of the report."""

import math

from deggflow.statistics import Rate

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def proportion(rate: Rate | None) -> str | None:
    """A rate of the paper as a percentage."""
    return None if rate is None else f"{100 * rate.proportion:.3g}%"


def listed(rates: list[Rate]) -> str:
    """Several rates with the same number of cases, as one line of the summary."""
    return " / ".join(f"{100 * rate.proportion:.1f}%" for rate in rates) + f" of {rates[0].cases:,}"


def cases(count: int) -> str:
    """A number of cases."""
    return f"{count:,} case" + "s" * (count != 1)


def scientific(value: float) -> str:
    """A number of any magnitude with few digits."""
    if value == 0 or 1e-3 <= abs(value) < 1e3:
        return f"{value:.3g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


def from_log(log: float) -> str:
    """A number of any magnitude, given by its natural logarithm."""
    if abs(log) < 100:
        return scientific(math.exp(log))
    exponent = math.floor(log / math.log(10))
    mantissa = math.exp(log - exponent * math.log(10))
    return f"{mantissa:.1f}·10{str(exponent).translate(_RAISED)}"
