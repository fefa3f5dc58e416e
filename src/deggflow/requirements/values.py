"""Numbers, arrays and regions that a requirement is given: constants, or parts of the condition."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Value = float | int | Float[Array | np.ndarray, "..."] | str | Callable[[Any], Any]
"""A constant, the name of an entry of the condition, or a function of the condition."""


def resolve(value: Any, condition: Any, dtype: Any) -> Any:
    """A value, its floating-point numbers in the type of the states.

    Args:
        value: A constant or a pytree of arrays; the name of an entry or attribute of the condition; or a function of it.
        condition: The condition.
        dtype: Type of the states.

    Example:
        >>> resolve("limit", {"limit": 0.5}, jnp.float32)
        Array(0.5, dtype=float32)
    """
    if isinstance(value, str):
        if isinstance(condition, Mapping) and value in condition:
            value = condition[value]
        elif hasattr(condition, value):
            value = getattr(condition, value)
        else:
            raise ValueError(
                f"the condition must have an entry {value!r}, which a requirement names; got {_described(condition)}."
            )
    elif callable(value):
        value = value(condition)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), value)


def _described(condition: Any) -> str:
    if isinstance(condition, Mapping):
        return f"entries {sorted(map(str, condition))}"
    return f"a {type(condition).__name__}"


def is_constant(value: Any) -> bool:
    """Whether a value is known without the condition."""
    return not isinstance(value, str) and not callable(value)


def check_positive(name: str, value: Any, meaning: str) -> None:
    """Raises `ValueError` unless a constant is positive and finite; functions of the condition are not looked at."""
    if value is None or not is_constant(value) or isinstance(value, jax.core.Tracer):
        return
    array = np.asarray(value)
    if not (
        np.issubdtype(array.dtype, np.number) and np.isfinite(array).all() and (array > 0).all()
    ):
        raise ValueError(f"`{name}` must be positive and finite, {meaning}; got {value}.")
