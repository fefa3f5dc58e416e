"""Vector fields from external models: calling conventions, checks of the output, and the adapter for JAX callables.

The adapter for PyTorch modules is `deggflow.field.torch`; it takes the same `call`, `extras` and `flat`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from deggflow.shapes import Scalar, States

Call = Callable[..., Any]
"""(model, x, t, **extras) -> velocity: passes the arguments in the order and form that a model expects."""

Extras = Callable[[Any], Mapping[str, Any]]
"""Further arguments of a model, by name, computed from the condition."""


def state_time(model: Callable[..., Any], x: Any, t: Any, **extras: Any) -> Any:
    """`model(x, t, **extras)`, the convention of facebookresearch/flow_matching."""
    return model(x, t, **extras)


def time_state(model: Callable[..., Any], x: Any, t: Any, **extras: Any) -> Any:
    """`model(t, x, **extras)`, the order of ODE solvers."""
    return model(t, x, **extras)


def no_extras(condition: Any) -> Mapping[str, Any]:
    """No further arguments: the model depends on state and time only."""
    return {}


def name_of(model: Callable[..., Any]) -> str:
    """The name of a model in error messages: a function's name, or an object's class."""
    return getattr(model, "__name__", type(model).__name__)


def check_velocity(
    model: Callable[..., Any],
    returned: Any,
    array: type[Any],
    floating: Callable[[Any], bool],
    expected: tuple[int, ...],
    axes: str,
) -> None:
    """Checks that the output of a model is a velocity of x.

    Args:
        model: The model, for the error message.
        returned: Its output.
        array: Type of arrays in the model's library.
        floating: Whether an array has a real floating-point type.
        expected: Shape of x.
        axes: Names of the axes of x, for the error message.

    Raises:
        ValueError: The output has another type or shape than x, or no floating-point numbers.
    """
    requirement = f"expected a velocity of shape {expected}, like x: ({axes})."
    if not isinstance(returned, array):
        problem = f"an object of type {type(returned).__name__}; {requirement}"
    elif tuple(returned.shape) != expected:
        problem = f"an array of shape {tuple(returned.shape)}; {requirement}"
    elif not floating(returned):
        problem = f"an array of type {returned.dtype}; a velocity has floating-point numbers."
    else:
        return
    raise ValueError(f"`{name_of(model)}` returned {problem}")


class JaxField(eqx.Module):
    """An external JAX callable as a vector field.

    The velocity is cast to the type of z. A model in bfloat16, or in float64 where that is enabled, thus changes the
    precision of the velocity but not that of the states.

    Attributes:
        model: Any callable that JAX can trace. The arrays of a model that is a pytree remain arguments of compiled
            programs.
        call: `state_time`, `time_state`, or any function `(model, x, t, **extras) -> velocity`.
        extras: Further arguments of the model, by name, computed from the condition.
        flat: Whether x is the joint state, of shape (agents * dim,).
        batched: Whether the model expects a leading axis of samples in x, t and the extras. The axis has length one;
            `jax.vmap` adds the batch.
    """

    model: Callable[..., Any]
    call: Call = eqx.field(static=True, default=state_time)
    extras: Extras = eqx.field(static=True, default=no_extras)
    flat: bool = eqx.field(static=True, default=False)
    batched: bool = eqx.field(static=True, default=False)

    def __call__(self, tau: Scalar, z: States, condition: Any) -> States:
        x, t, extras = z.reshape(-1) if self.flat else z, tau, dict(self.extras(condition))
        axes = "agents * dim" if self.flat else "agents, dim"
        if self.batched:
            x, t, extras = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], (x, t, extras))
            axes = f"samples, {axes}"
        velocity = self.call(self.model, x, t, **extras)
        check_velocity(self.model, velocity, jax.Array, _floating, x.shape, axes)
        return velocity.reshape(z.shape).astype(z.dtype)


def _floating(array: Array) -> bool:
    return jnp.issubdtype(array.dtype, jnp.floating)
