"""When a generation has diverged, and what stands for its numbers in files: decided here for all."""

import math
from typing import Any

import numpy as np

REASON = "the generation diverged to numbers that are not finite"
END_OF_SCALE = 1e12  # what files hold for numbers beyond it


def has_diverged(values: np.ndarray, limit: float = END_OF_SCALE) -> bool:
    """Whether some value is NaN, or larger than the limit, beyond which files hold none.

    Args:
        values: Of one generation, any shape.
        limit: In the unit of the values.
    """
    return not bool((np.abs(values) <= limit).all())


def finite(value: Any) -> float:
    """A number that files can hold: NaN stands as `END_OF_SCALE`, what is larger is cut there."""
    number = float(value)
    return END_OF_SCALE if math.isnan(number) else min(max(number, -END_OF_SCALE), END_OF_SCALE)
