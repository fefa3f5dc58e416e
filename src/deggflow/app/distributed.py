"""Several processes and devices that train one field."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from deggflow.jsonl import InputError
from deggflow.shards import Shard

if TYPE_CHECKING:
    import jax

_ADDRESS = re.compile(r"[^\s:]+:[0-9]{1,5}|\[[0-9a-fA-F:]+\]:[0-9]{1,5}")


def connect(coordinator: str | None, process: str | None) -> None:
    """Connects this process to the others of a training run; must be called before JAX computes anything.

    Args:
        coordinator: HOST:PORT at which the first process listens, and only there; None: this process trains alone.
        process: k/n, process number k of n.

    Raises:
        InputError: Only one of them is given, or one is invalid.
    """
    if (coordinator is None) != (process is None):
        raise InputError("--coordinator HOST:PORT and --process k/n go together")
    if coordinator is None or process is None:
        return
    if not _ADDRESS.fullmatch(coordinator):
        raise InputError(f"--coordinator must be HOST:PORT; got {coordinator!r}")
    try:
        own = Shard.parse(process)
    except InputError as error:
        raise InputError(error.reason.replace("--shard", "--process").split(",")[0]) from None
    import jax

    jax.distributed.initialize(
        coordinator, own.of, own.number - 1, coordinator_bind_address=coordinator
    )


def is_first() -> bool:
    """Whether this process writes and reports: the only one, or the first of several."""
    import jax

    return jax.process_index() == 0


def selected_devices(each: int, batch: int) -> "Sequence[jax.Device] | None":
    """The devices that divide a batch: so many of each process, 0 for all; None for the default one.

    Raises:
        InputError: A process has fewer, or they can't divide the batch equally.
    """
    import jax

    if each == 1 and jax.process_count() == 1:
        return None
    devices: list[jax.Device] = []
    for number in range(jax.process_count()):
        own = [device for device in jax.devices() if device.process_index == number]
        if len(own) < each:
            raise InputError(
                f"--devices must be at most {len(own)}, the devices of process {number + 1}; got {each}"
            )
        devices += own[: each or None]
    if batch % len(devices):
        raise InputError(f"--batch must be a multiple of {len(devices)} devices; got {batch}")
    return devices
