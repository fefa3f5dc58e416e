"""PyTorch modules as vector fields, evaluated by PyTorch inside compiled JAX programs.

A batch is one call of the module, whatever the samples' tau. `buffer_callback` hands over the memory of JAX itself, by
DLPack. `pure_callback` makes JAX arrays inside the callback: a call that does nothing takes two to seven times as long
(benchmarks/foreign_models.py), and on one core, with twenty programs under way and a million numbers a call, it hung.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.buffer_callback import buffer_callback
from jaxtyping import Array, Float

from .foreign import Call, Extras, check_velocity, name_of, no_extras, state_time

try:
    import torch as torch  # and re-exported: who needs it here finds the message below
    from torch.utils.dlpack import from_dlpack
except ModuleNotFoundError as error:
    raise ImportError("PyTorch modules need PyTorch: pip install 'deggflow[torch]'") from error


def joined(
    model: Callable[..., Any], x: torch.Tensor, t: torch.Tensor, **extras: torch.Tensor
) -> Any:
    """`model(cat([x, t], 1), **extras)` of joint states, as torchcfm's MLP takes them."""
    return model(torch.cat([x, t[:, None]], dim=1), **extras)


def at_one_time(
    model: Callable[..., Any], x: torch.Tensor, t: torch.Tensor, **extras: torch.Tensor
) -> Any:
    """`model(t, x, **extras)` with one time for a whole batch, as torchcfm's `torch_wrapper` is called.

    Samples of the same time go together: with fixed steps all of them, with guarded steps few.
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

    The module computes on its own device and in its own floating-point type, those of its first floating-point
    parameter or buffer; z, tau and floating-point extras are cast to it, the velocity is cast back. Integer extras become
    int64, PyTorch's type of indices. It must be in evaluation mode: compiled programs take its output for a function of
    its input. Nothing of it is changed, and weights that you change count from the next call on.

    Args:
        model: The module.
        call: `state_time`, `time_state`, `joined`, `at_one_time`, or a function of yours `(model, x, t, **extras) ->
            velocity`. x has shape (samples, agents, dim), t (samples,), and extras a leading axis of samples, too.
        extras: From the condition, what the module takes by name: arrays of one sample.
        flat: x is the joint state, of shape (samples, agents * dim).
        lend: Give the module the memory of JAX instead of a copy. For modules that neither write to their inputs
            (an error tells of it, after the fact) nor keep them.
    """

    model: Callable[..., Any]
    call: Call = state_time
    extras: Extras = no_extras
    flat: bool = False
    lend: bool = False

    def __call__(
        self, tau: Float[Array, ""], z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, "agents dim"]:
        self._check_mode()  # before anything is compiled, where it can be
        extras = {name: jnp.asarray(value) for name, value in self.extras(condition).items()}
        velocity = jax.ShapeDtypeStruct(z.shape, z.dtype)
        evaluate = buffer_callback(self._evaluate, velocity, vmap_method="broadcast_all")
        return evaluate(tau, z, extras)

    def _evaluate(self, context: Any, out: Any, tau: Any, z: Any, extras: dict[str, Any]) -> None:
        """Runs the module on buffers of JAX; their leading axes are those of `jax.vmap`. Nothing here is done by JAX."""
        self._check_mode()
        lanes, (agents, dim) = len(tau.shape), z.shape[-2:]
        x = self._tensor(z, (agents * dim,) if self.flat else (agents, dim))
        t = self._tensor(tau, ())
        given = {name: self._tensor(value, value.shape[lanes:]) for name, value in extras.items()}
        inputs = {"x": x, "t": t, **given}
        versions = {name: tensor._version for name, tensor in inputs.items()}
        # Not `inference_mode`: there, a module could not take gradients under its own `enable_grad`.
        with torch.no_grad():
            try:
                velocity = self.call(self.model, x, t, **given)
            except Exception as error:
                got = ", ".join(f"{name} {_described(one)}" for name, one in inputs.items())
                raise RuntimeError(
                    f"`{name_of(self.model)}` failed on {got}. {type(error).__name__}: {error}"
                ) from error
            self._check_inputs(inputs, versions)
            axes = "samples, agents * dim" if self.flat else "samples, agents, dim"
            check_velocity(
                self.model, velocity, torch.Tensor, torch.is_floating_point, tuple(x.shape), axes
            )
            # Into the memory of JAX: whatever the module does with its own later, this stays.
            from_dlpack(out).copy_(velocity.reshape(out.shape))

    def _tensor(self, buffer: Any, shape: tuple[int, ...]) -> torch.Tensor:
        """What the module is given for a buffer, of one sample's `shape` behind an axis of samples."""
        memory = from_dlpack(buffer)
        if memory.device.type != "cpu":
            raise RuntimeError(
                "PyTorch modules can be guided where JAX computes on the CPU: set JAX_PLATFORMS=cpu."
            )
        device, dtype = _home(self.model, memory.dtype)
        if not memory.is_floating_point():
            dtype = torch.int64 if memory.dtype == torch.int32 else memory.dtype
        # A copy, as the memory is JAX's: its arrays never change, and it is reused after this call.
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
                f"`{name_of(self.model)}` has written to its input `{changed[0]}`, memory that JAX lent it and whose "
                "values may be wrong now, wherever they are in use; such a module needs `lend=False`."
            )


def _home(model: Callable[..., Any], default: torch.dtype) -> tuple[torch.device, torch.dtype]:
    """Where a module computes and in which type."""
    if isinstance(model, torch.nn.Module):
        for tensor in chain(model.parameters(), model.buffers()):
            if tensor.is_floating_point():
                return tensor.device, tensor.dtype
    return torch.device("cpu"), default


def _described(tensor: torch.Tensor) -> str:
    return f"{tuple(tensor.shape)} {tensor.dtype}".replace("torch.", "")
