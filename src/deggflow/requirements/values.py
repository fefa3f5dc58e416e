"""Numbers, arrays and regions that a requirement is given: constants, or parts of the condition."""

import numbers
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Value = (
    float
    | int
    | Float[Array | np.ndarray, "..."]
    | list[Any]
    | tuple[Any, ...]
    | str
    | Callable[[Any], Any]
)
"""A constant, with lists and tuples of numbers, the name of an entry of the condition, or a function of the condition."""


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
    if isinstance(value, list | tuple) and _holds_numbers(value):
        value = np.asarray(value, float)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), value)


def _holds_numbers(value: Any) -> bool:
    """Whether nested lists hold numbers, and something at all: a tuple of regions does not."""
    if isinstance(value, list | tuple):
        return len(value) > 0 and all(map(_holds_numbers, value))
    return isinstance(value, numbers.Real)


def one_or_each(name: str, value: Value, agents: int, condition: Any, dtype: Any) -> Any:
    """A number as `resolve` returns it, or one for each agent, shape (agents,).

    Raises:
        ValueError: It has another shape.
    """
    found = resolve(value, condition, dtype)
    if found.shape not in ((), (agents,)):
        raise ValueError(
            f"`{name}` must be one number or one for each of {agents} agents; got shape {found.shape}."
        )
    return found


def column(name: str, value: Value, agents: int, condition: Any, dtype: Any) -> Any:
    """As `one_or_each`, of several a column: against an array of agents x steps."""
    found = one_or_each(name, value, agents, condition, dtype)
    return found if found.ndim == 0 else found[:, None]


def of_team(name: str, value: Value, condition: Any, dtype: Any) -> Any:
    """A number as `resolve` returns it, which holds of the whole team.

    Raises:
        ValueError: It is an array.
    """
    found = resolve(value, condition, dtype)
    if found.shape != ():
        raise ValueError(
            f"`{name}` must be one number, of the whole team; got shape {found.shape}."
        )
    return found


def _described(condition: Any) -> str:
    if isinstance(condition, Mapping):
        return f"entries {sorted(map(str, condition))}"
    return f"a {type(condition).__name__}"


def is_constant(value: Any) -> bool:
    """Whether a value is known without the condition."""
    return not isinstance(value, str) and not callable(value)


def check_positive(name: str, value: Any, meaning: str) -> None:
    """Raises `ValueError` unless a constant is positive and finite; functions of the condition are not looked at."""
    _check(name, value, f"positive and finite, {meaning}", lambda array: array > 0)


def check_nonnegative(name: str, value: Any, meaning: str) -> None:
    """As `check_positive`, and zero is allowed."""
    _check(name, value, f"nonnegative and finite, {meaning}", lambda array: array >= 0)


def check_finite(name: str, value: Any, meaning: str) -> None:
    """As `check_positive`, of any sign."""
    _check(name, value, f"finite, {meaning}", np.isfinite)


def _check(name: str, value: Any, meaning: str, allowed: Callable[[Any], Any]) -> None:
    if value is None or not is_constant(value) or isinstance(value, jax.core.Tracer):
        return
    array = np.asarray(value)
    if not (
        np.issubdtype(array.dtype, np.number)
        and np.isfinite(array).all()
        and np.all(allowed(array))
    ):
        raise ValueError(f"`{name}` must be {meaning}; got {value}.")
