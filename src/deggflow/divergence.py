"""The criterion for divergence, and the numbers that files hold for values that are not finite or too large."""

import math
from typing import Any

import numpy as np

REASON = "the generation diverged to numbers that are not finite"
END_OF_SCALE = 1e12  # files hold this for larger numbers


def has_diverged(values: np.ndarray, limit: float = END_OF_SCALE) -> bool:
    """Whether some value is NaN or exceeds the limit in magnitude.

    Args:
        values: Values of one generation, any shape.
        limit: Limit in the unit of the values.
    """
    return not bool((np.abs(values) <= limit).all())


def finite(value: Any) -> float:
    """A number for files: NaN becomes `END_OF_SCALE`, and magnitudes are clipped to it."""
    number = float(value)
    return END_OF_SCALE if math.isnan(number) else min(max(number, -END_OF_SCALE), END_OF_SCALE)
