"""PyTorch modules as vector fields, evaluated by PyTorch inside compiled JAX programs.

A batch is one call of the module, even if its samples differ in tau. `buffer_callback` passes the memory of JAX itself,
by DLPack. `pure_callback` would create JAX arrays inside the callback. An empty call then takes two to seven times as
long (benchmarks/foreign_models.py), and it deadlocked on one core with twenty concurrent programs and a million numbers
per call.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.buffer_callback import buffer_callback

from deggflow.shapes import Scalar, States

from .foreign import Call, Extras, check_velocity, name_of, no_extras, state_time

try:
    import torch as torch  # re-exported, so that importers get the error message below
    from torch.utils.dlpack import from_dlpack as from_dlpack
except ModuleNotFoundError as error:
    raise ImportError("PyTorch modules need PyTorch: pip install 'deggflow[torch]'") from error


def joined(
    model: Callable[..., Any], x: torch.Tensor, t: torch.Tensor, **extras: torch.Tensor
) -> Any:
    """`model(cat([x, t], 1), **extras)` for joint states, the convention of torchcfm's MLP."""
    return model(torch.cat([x, t[:, None]], dim=1), **extras)


def at_one_time(
    model: Callable[..., Any], x: torch.Tensor, t: torch.Tensor, **extras: torch.Tensor
) -> Any:
    """`model(t, x, **extras)` with one time for a whole batch, the convention of torchcfm's `torch_wrapper`.

    Samples with the same time share a call: with fixed steps these are all samples, with guarded steps only a few.
    """
    times, which = torch.unique(t, return_inverse=True)
    parts = [torch.nonzero(which == k)[:, 0] for k in range(len(times))]
    velocities = [
        model(time, x[part], **{name: value[part] for name, value in extras.items()})
        for time, part in zip(times, parts, strict=True)
    ]
    return torch.cat(velocities)[torch.argsort(torch.cat(parts))]


@dataclass(frozen=True, eq=False)
class TorchField:
    """A PyTorch module, or any callable of tensors, as a vector field.

    The module computes on the device and in the floating-point type of its first floating-point parameter or buffer.
    z, tau and floating-point extras are cast to this type, and the velocity is cast back. Integer extras become int64,
    PyTorch's type of indices. The module must be in evaluation mode, as compiled programs assume that its output is a
    function of its input. The module is not modified, and changed weights are used from the next call on.

    Attributes:
        model: The module.
        call: `state_time`, `time_state`, `joined`, `at_one_time`, or any function `(model, x, t, **extras) ->
            velocity`. x has shape (samples, agents, dim), t has shape (samples,), and extras have a leading axis of
            samples.
        extras: Further arguments of the module, by name: arrays of one sample, computed from the condition.
        flat: Whether x is the joint state, of shape (samples, agents * dim).
        lend: Whether the module receives the memory of JAX instead of a copy. Only for modules that neither keep their
            inputs nor write to them; writing raises an error, but only afterwards.
    """

    model: Callable[..., Any]
    call: Call = state_time
    extras: Extras = no_extras
    flat: bool = False
    lend: bool = False

    def __call__(self, tau: Scalar, z: States, condition: Any) -> States:
        self._check_mode()  # before anything is compiled, where it can be
        extras = {name: jnp.asarray(value) for name, value in self.extras(condition).items()}
        velocity = jax.ShapeDtypeStruct(z.shape, z.dtype)
        evaluate = buffer_callback(self._evaluate, velocity, vmap_method="broadcast_all")
        return evaluate(tau, z, extras)

    def _evaluate(self, context: Any, out: Any, tau: Any, z: Any, extras: dict[str, Any]) -> None:
        """Runs the module on buffers of JAX, whose leading axes are those of `jax.vmap`, without calling JAX."""
        self._check_mode()
        batch_axes, (agents, dim) = len(tau.shape), z.shape[-2:]
        x = self._tensor(z, (agents * dim,) if self.flat else (agents, dim))
        t = self._tensor(tau, ())
        tensors = {
            name: self._tensor(value, value.shape[batch_axes:]) for name, value in extras.items()
        }
        inputs = {"x": x, "t": t, **tensors}
        versions = {name: tensor._version for name, tensor in inputs.items()}
        # In `inference_mode`, a module could not enable gradients with its own `enable_grad`.
        with torch.no_grad():
            try:
                velocity = self.call(self.model, x, t, **tensors)
            except Exception as error:
                shapes = ", ".join(f"{name} {_described(one)}" for name, one in inputs.items())
                raise RuntimeError(
                    f"`{name_of(self.model)}` failed on {shapes}. {type(error).__name__}: {error}"
                ) from error
            self._check_inputs(inputs, versions)
            axes = "samples, agents * dim" if self.flat else "samples, agents, dim"
            check_velocity(
                self.model, velocity, torch.Tensor, torch.is_floating_point, tuple(x.shape), axes
            )
            # Copied into memory owned by JAX, as the module may reuse its own buffer.
            from_dlpack(out).copy_(velocity.reshape(out.shape))

    def _tensor(self, buffer: Any, shape: tuple[int, ...]) -> torch.Tensor:
        """The module's input for a buffer: an axis of samples, followed by the `shape` of one sample."""
        memory = from_dlpack(buffer)
        if memory.device.type != "cpu":
            raise RuntimeError(
                "PyTorch modules can only be guided if JAX computes on the CPU: set JAX_PLATFORMS=cpu."
            )
        device, dtype = _home(self.model, memory.dtype)
        if not memory.is_floating_point():
            dtype = torch.int64 if memory.dtype == torch.int32 else memory.dtype
        # A copy, as JAX arrays are immutable and JAX reuses their memory after this call.
        return memory.to(device, dtype, copy=not self.lend).reshape(-1, *shape)

    def _check_mode(self) -> None:
        if isinstance(self.model, torch.nn.Module) and self.model.training:
            raise ValueError(
                f"`{name_of(self.model)}` is in training mode, in which dropout or batch normalisation "
                "make its output depend on more than its input; call its `eval()` first."
            )

    def _check_inputs(self, inputs: dict[str, torch.Tensor], before: dict[str, int]) -> None:
        changed = [name for name, tensor in inputs.items() if tensor._version != before[name]]
        if self.lend and changed:
            raise ValueError(
                f"`{name_of(self.model)}` has written to its input `{changed[0]}`. This memory belongs to JAX, and "
                "other computations that use it may now be wrong; this module needs `lend=False`."
            )


def _home(model: Callable[..., Any], default: torch.dtype) -> tuple[torch.device, torch.dtype]:
    """Device and floating-point type of a module."""
    if isinstance(model, torch.nn.Module):
        for tensor in chain(model.parameters(), model.buffers()):
            if tensor.is_floating_point():
                return tensor.device, tensor.dtype
    return torch.device("cpu"), default


def _described(tensor: torch.Tensor) -> str:
    return f"{tuple(tensor.shape)} {tensor.dtype}".replace("torch.", "")
