"""Models from outside as vector fields: how they are called, what they must return, and the adapter for JAX callables.

The adapter for PyTorch modules is `deggflow.field.torch`; it takes the same `call`, `extras` and `flat`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Call = Callable[..., Any]
"""(model, x, t, **extras) -> velocity: in which order and form a model takes its arguments."""

Extras = Callable[[Any], Mapping[str, Any]]
"""What else a model takes, by name, from the condition."""


def state_time(model: Callable[..., Any], x: Any, t: Any, **extras: Any) -> Any:
    """`model(x, t, **extras)`, as facebookresearch/flow_matching has it."""
    return model(x, t, **extras)


def time_state(model: Callable[..., Any], x: Any, t: Any, **extras: Any) -> Any:
    """`model(t, x, **extras)`, the order of ODE solvers."""
    return model(t, x, **extras)


def no_extras(condition: Any) -> Mapping[str, Any]:
    """A model that reads state and time only."""
    return {}


def name_of(model: Callable[..., Any]) -> str:
    """What messages call a model: a function's name, or the class of an object."""
    return getattr(model, "__name__", type(model).__name__)


def check_velocity(
    model: Callable[..., Any],
    returned: Any,
    array: type[Any],
    floating: Callable[[Any], bool],
    expected: tuple[int, ...],
    axes: str,
) -> None:
    """Refuses what is no velocity of x.

    Args:
        model: Who returned it.
        returned: What came.
        array: What arrays are in the model's library.
        floating: Whether such an array has real floating-point numbers.
        expected: Shape of x.
        axes: What the axes of x are.
    """
    wanted = f"expected a velocity of shape {expected}, as x has it: ({axes})."
    if not isinstance(returned, array):
        found = f"an object of type {type(returned).__name__}; {wanted}"
    elif tuple(returned.shape) != expected:
        found = f"an array of shape {tuple(returned.shape)}; {wanted}"
    elif not floating(returned):
        found = f"an array of type {returned.dtype}; a velocity has floating-point numbers."
    else:
        return
    raise ValueError(f"`{name_of(model)}` returned {found}")


class JaxField(eqx.Module):
    """A JAX callable from outside as a vector field.

    The velocity is cast to the type of z: a model in bfloat16, or in float64 where that is enabled, changes the
    precision of the velocity and never that of the states.

    Args:
        model: Any callable that JAX can trace. Arrays of a model that is a pytree stay arguments of compiled programs.
        call: `state_time`, `time_state`, or a function of yours `(model, x, t, **extras) -> velocity`.
        extras: From the condition, what the model takes by name.
        flat: x is the joint state, of shape (agents * dim,).
        batched: The model expects a leading axis of samples, in t and in the extras, too; it sees one sample at a
            time there, and `jax.vmap` makes the batch.
    """

    model: Callable[..., Any]
    call: Call = eqx.field(static=True, default=state_time)
    extras: Extras = eqx.field(static=True, default=no_extras)
    flat: bool = eqx.field(static=True, default=False)
    batched: bool = eqx.field(static=True, default=False)

    def __call__(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, "agents dim"]:
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
