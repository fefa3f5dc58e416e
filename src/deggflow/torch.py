"""For users of PyTorch: requirements written in PyTorch, and certified samples as tensors. Needs `deggflow[torch]`.

Values and gradients come from PyTorch's autograd, inside compiled programs, in one call for a whole batch. States are
float32 while a sample is generated and float64 for the verdict; functions receive both, on the CPU, and must compute in
the type of `z`. Nothing here asks for a line of JAX.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.buffer_callback import buffer_callback
from jaxtyping import Array, Bool, Float

from deggflow.shapes import AgentValues, Scalar, States

from . import sampling
from .certificate import Certificate
from .field.foreign import name_of
from .field.torch import TorchField, from_dlpack, torch
from .guidance import AbstractMargins, AbstractRequirement, DecoupledGuidance

__all__ = ["TensorSamples", "TorchMargins", "TorchValue", "sample"]


def _call(
    compute: Callable[..., Any],
    outputs: tuple[jax.ShapeDtypeStruct, ...],
    leaves: tuple[Array, ...],
) -> tuple[Array, ...]:
    """Runs a function of tensors inside a compiled program; every tensor has one leading axis of samples."""
    sizes = [leaf.ndim for leaf in leaves]

    def run(context: Any, out: Any, *buffers: Any) -> None:
        tensors = []
        for buffer, size in zip(buffers, sizes, strict=True):
            tensor = from_dlpack(buffer)
            shape = tensor.shape[tensor.ndim - size :]
            tensors.append(tensor.reshape(-1, *shape).clone())  # JAX reuses its memory
        for target, value in zip(out, compute(*tensors), strict=True):
            into = from_dlpack(target)
            into.copy_(value.detach().reshape(into.shape))

    return tuple(buffer_callback(run, outputs, vmap_method="broadcast_all")(*leaves))


class _Function(NamedTuple):
    """A function of tensors with a condition, a tree whose leaves travel as buffers."""

    function: Callable[..., "torch.Tensor"]
    structure: Any

    def __call__(self, *tensors: "torch.Tensor", states: int = 1) -> "torch.Tensor":
        """The function of the first `states` tensors and the condition that is made of the others."""
        condition = jax.tree.unflatten(self.structure, tensors[states:])
        value = self.function(*tensors[:states], condition)
        if not isinstance(value, torch.Tensor) or not value.is_floating_point():
            kind = value.dtype if isinstance(value, torch.Tensor) else type(value).__name__
            raise TypeError(
                f"`{name_of(self.function)}` must return a tensor of floating-point numbers; got {kind}."
            )
        return value

    def check(
        self, value: "torch.Tensor", z: States, expected: tuple[int | None, ...], axes: str
    ) -> None:
        """Raises an error unless a value has the expected shape (None: any) and the type of the states."""
        shape = tuple(value.shape)
        same = len(shape) == len(expected) and all(
            size == other or (other is None and size > 0)
            for size, other in zip(shape, expected, strict=True)
        )
        if not same:
            raise ValueError(
                f"`{name_of(self.function)}` must return shape ({axes}) for z of shape {(1, *z.shape)}; got {shape}."
            )
        if str(value.dtype) != f"torch.{z.dtype}":
            raise TypeError(
                f"`{name_of(self.function)}` must compute in the type of z; got {value.dtype} for {z.dtype}: "
                "verdicts are made in float64."
            )


def _condition(condition: Any) -> tuple[list[Array], Any]:
    leaves, structure = jax.tree.flatten(condition)
    return [jnp.asarray(leaf) for leaf in leaves], structure


def _like(leaf: Array) -> "torch.Tensor":
    """Zeros of the shape and type of an array, for one sample."""
    return torch.from_numpy(np.zeros((1, *leaf.shape), leaf.dtype))


class TorchMargins(AbstractMargins):
    """Margins h_jk written in PyTorch, for `PrivateRequirement`; gradients are taken by autograd.

    Attributes:
        function: `(z, condition) -> margins` with z of shape (samples, agents, dim) and margins of shape (samples,
            agents, margins), `>= 0` where they hold. The leaves of the condition are tensors with a leading axis of
            samples. The function must be differentiable where margins are below the buffer, and must not mix samples.

    Raises:
        TypeError: The function returns something else than floating-point numbers of the type of z.
        ValueError: The margins have another shape.

    Example:
        >>> def apart(z, condition):
        ...     distance = torch.cdist(z, z) + 10 * torch.eye(z.shape[1], dtype=z.dtype)
        ...     return distance - 0.3
        >>> requirement = PrivateRequirement(TorchMargins(apart), buffer=0.02, name="apart")
        >>> float(requirement.violation(jnp.array([[0.0, 0.0], [1.0, 0.0]]), None))
        0.0
    """

    function: Callable[[Any, Any], Any] = eqx.field(static=True)

    def _bound(self, z: States, condition: Any) -> tuple[_Function, list[Array], int]:
        """The function, its buffers, and the number of its margins, known from one call on zeros."""
        leaves, structure = _condition(condition)
        function = _Function(self.function, structure)
        with torch.no_grad():
            value = function(_like(z), *map(_like, leaves))
        function.check(value, z, (1, z.shape[0], None), "samples, agents, margins")
        return function, leaves, value.shape[2]

    def __call__(self, z: States, condition: Any) -> Float[Array, "agents margins"]:
        """The margins."""
        function, leaves, count = self._bound(z, condition)

        def compute(*tensors: torch.Tensor) -> tuple[torch.Tensor]:
            with torch.no_grad():
                return (function(*tensors),)

        shape = jax.ShapeDtypeStruct((z.shape[0], count), z.dtype)
        return _call(compute, (shape,), (z, *leaves))[0]

    def violation(self, z: States, condition: Any, buffer: float) -> AgentValues:
        """V_j of each agent."""
        return jnp.sum(jnp.maximum(buffer - self(z, condition), 0.0) ** 2, axis=-1) / 2

    def violation_and_gradient(
        self, z: States, condition: Any, buffer: float
    ) -> tuple[AgentValues, States]:
        """V_j, and the gradient of their sum, by one call of the function and one backward pass."""
        function, leaves, _ = self._bound(z, condition)

        def compute(z: torch.Tensor, *others: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            parts, z = _violation(function, z, others, buffer)
            return parts, _gradient(parts, z)

        parts = jax.ShapeDtypeStruct(z.shape[:1], z.dtype)
        gradient = jax.ShapeDtypeStruct(z.shape, z.dtype)
        value, slope = _call(compute, (parts, gradient), (z, *leaves))
        return value, slope

    def dependence(self, z: States, condition: Any, buffer: float) -> Bool[Array, "owners agents"]:
        """Who can change V_j to first order, by one backward pass for each owner, and j itself."""
        function, leaves, _ = self._bound(z, condition)

        def compute(z: torch.Tensor, *others: torch.Tensor) -> tuple[torch.Tensor]:
            parts, z = _violation(function, z, others, buffer)
            slopes = [_gradient(parts[:, j], z, keep=True) for j in range(z.shape[1])]
            return (torch.stack([slope.abs().sum(dim=-1) for slope in slopes], dim=1),)

        agents = z.shape[0]
        shape = jax.ShapeDtypeStruct((agents, agents), z.dtype)
        slopes = _call(compute, (shape,), (z, *leaves))[0]
        return (slopes != 0) | jnp.eye(agents, dtype=bool)


def _violation(
    function: _Function, z: "torch.Tensor", others: Sequence["torch.Tensor"], buffer: float
) -> tuple["torch.Tensor", "torch.Tensor"]:
    """V_j of each agent, attached to the states beside it."""
    with torch.enable_grad():
        z = z.requires_grad_()
        return (buffer - function(z, *others)).clamp(min=0).square().sum(dim=-1) / 2, z


def _gradient(value: "torch.Tensor", z: "torch.Tensor", keep: bool = False) -> "torch.Tensor":
    """The gradient of the sum in z; zero where the value does not depend on z."""
    if not value.requires_grad:
        return torch.zeros_like(z)
    (slope,) = torch.autograd.grad(value.sum(), z, retain_graph=keep, allow_unused=True)
    return torch.zeros_like(z) if slope is None else slope


class TorchValue(eqx.Module):
    """q(tau, z, condition) written in PyTorch, the `value` of a `SharedFactor`; derivatives are taken by autograd.

    Attributes:
        function: `(t, z, condition) -> q` with t and q of shape (samples,) and z of shape (samples, agents, dim). The
            leaves of the condition are tensors with a leading axis of samples.

    Raises:
        TypeError: The function returns something else than floating-point numbers of the type of z.
        ValueError: q has another shape.

    Example:
        >>> spread = TorchValue(lambda t, z, condition: z.var(dim=1).sum(dim=-1) - 1)
        >>> float(spread(jnp.asarray(0.0), jnp.array([[0.0], [2.0]]), None))
        1.0
    """

    function: Callable[[Any, Any, Any], Any] = eqx.field(static=True)

    def __call__(self, tau: Scalar, z: States, condition: Any) -> Scalar:
        """The value."""
        leaves, structure = _condition(condition)

        function = _Function(self.function, structure)
        at: Callable[..., torch.Tensor] = partial(function.__call__, states=2)
        tau = jnp.asarray(tau, z.dtype)
        with torch.no_grad():
            value = at(_like(tau), _like(z), *map(_like, leaves))
        function.check(value, z, (1,), "samples,")
        return _differentiable(at, tau, z, leaves)


def _differentiable(
    at: Callable[..., "torch.Tensor"], tau: Scalar, z: States, leaves: list[Array]
) -> Scalar:
    """The value with derivatives in tau and z, for JAX's reverse mode."""
    number = jax.ShapeDtypeStruct((), z.dtype)

    def plain(t: torch.Tensor, z: torch.Tensor, *others: torch.Tensor) -> tuple[torch.Tensor]:
        with torch.no_grad():
            return (at(t, z, *others),)

    def with_slopes(
        t: torch.Tensor, z: torch.Tensor, *others: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        with torch.enable_grad():
            t, z = t.requires_grad_(), z.requires_grad_()
            value = at(t, z, *others)
        return value, _gradient(value, t, keep=True), _gradient(value, z)

    @jax.custom_vjp
    def q(tau: Scalar, z: States, leaves: list[Array]) -> Scalar:
        return _call(plain, (number,), (tau, z, *leaves))[0]

    def forward(tau: Scalar, z: States, leaves: list[Array]) -> tuple[Scalar, Any]:
        shapes = number, number, jax.ShapeDtypeStruct(z.shape, z.dtype)
        value, in_tau, in_z = _call(with_slopes, shapes, (tau, z, *leaves))
        return value, (in_tau, in_z)

    def backward(slopes: Any, cotangent: Scalar) -> tuple[Scalar, States, None]:
        in_tau, in_z = slopes
        return cotangent * in_tau, cotangent * in_z, None

    q.defvjp(forward, backward)
    return q(tau, z, leaves)


@dataclass(frozen=True)
class TensorSamples:
    """Finished samples as a tensor, with their certificates.

    Attributes:
        z: States at tau = 1, shape (samples, agents, dim), float32 on the CPU.
        samples: The same as `deggflow.sample` returns it.
    """

    z: "torch.Tensor"
    samples: sampling.Samples

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """One for each sample."""
        return self.samples.certificates

    @property
    def satisfied(self) -> "torch.Tensor":
        """Which samples meet every requirement, shape (samples,)."""
        return torch.from_numpy(self.samples.satisfied)

    def __str__(self) -> str:
        """As the samples themselves say it."""
        return str(self.samples)


def sample(
    model: Any,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    seed: int,
    count: int,
    shape: tuple[int, int],
    conditions: Any = None,
    **settings: Any,
) -> TensorSamples:
    """`deggflow.sample` of a PyTorch model, with tensors in and out.

    Args:
        model: A module called as `model(x, t)` with x of shape (samples, agents, dim), or a `TorchField` for any other
            convention.
        requirements: Requirements, written in PyTorch (`TorchMargins`, `TorchValue`) or named ones.
        condition: One condition for all samples: tensors, arrays and numbers in tuples, lists and dictionaries.
        seed: Decides z(0).
        count: How many samples.
        shape: (agents, dim) of a state.
        conditions: One condition for each sample instead: tensors have a leading axis of `count`.
        settings: Further arguments of `deggflow.sample`, such as `grid`, `drift`, `max_draws` and `on_progress`.

    Raises:
        ValueError: As `deggflow.sample`.

    Example:
        >>> model = torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(4, 4), torch.nn.Unflatten(1, (2, 2)))
        >>> field = TorchField(model.eval(), lambda model, x, t: model(x))
        >>> requirement = PrivateRequirement(TorchMargins(lambda z, condition: z), 0.05, name="positive")
        >>> result = sample(field, (requirement,), seed=0, count=3, shape=(2, 2))
        >>> result.z.shape, bool(result.satisfied.all())
        (torch.Size([3, 2, 2]), True)
    """
    result = sampling.sample(
        model if isinstance(model, TorchField) else _field(model), requirements, _arrays(condition),
        key=jax.random.key(seed), count=count, shape=shape, conditions=_arrays(conditions), **settings,
    )  # fmt: skip
    return TensorSamples(torch.from_numpy(np.array(result.z)), result)


@lru_cache(maxsize=16)
def _field(model: Any) -> TorchField:
    """One field for each module, so that a second call does not compile again."""
    return TorchField(model)


def _arrays(tree: Any) -> Any:
    """Tensors as numpy arrays."""
    return jax.tree.map(
        lambda leaf: leaf.detach().cpu().numpy() if isinstance(leaf, torch.Tensor) else leaf, tree
    )
