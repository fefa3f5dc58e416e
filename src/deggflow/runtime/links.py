"""Transports by name and address, and one transport for two kinds of messages."""

import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from .transport import Transport, UdpTransport, free_addresses
from .zenoh_transport import LOOPBACK, ZenohTransport

TransportName = Literal["udp", "zenoh"]
KEPT = 256  # messages of the kind that nobody is waiting for


def open_transport(
    name: TransportName, number: int, addresses: Sequence[str], config: Path | None = None
) -> Transport:
    """A transport between addresses that all processes are given in the same order.

    Args:
        name: udp or zenoh.
        number: Of this process.
        addresses: Of all processes by number: HOST:PORT for udp, such as "127.0.0.1:7500"; for zenoh its endpoints, such as
            "tcp/127.0.0.1:7500".
        config: File of Zenoh's settings, as of `ZenohTransport`.

    Raises:
        ValueError: An address is of another form, given twice, or `config` is given for udp.
        OSError: The address can't be bound, or a host is unknown.
        ImportError: Zenoh is not installed.
        TeamError: Zenoh can't open its session.
    """
    if not 0 <= number < len(addresses):
        raise ValueError(f"`number` must be in [0, {len(addresses) - 1}]; got {number}.")
    if len(set(addresses)) < len(addresses):
        raise ValueError(f"`addresses` must differ from one another; got {', '.join(addresses)}.")
    if name == "udp":
        if config is not None:
            raise ValueError(f"`config` is for zenoh; got {config} for udp.")
        return UdpTransport(number, [_host_and_port(address) for address in addresses])
    for address in addresses:
        if "/" not in address:
            raise ValueError(
                f'`addresses` of zenoh must be PROTOCOL/HOST:PORT, such as "tcp/{address}"; got {address}.'
            )
    return ZenohTransport(number, addresses, config=config)


def loopback_addresses(name: TransportName, count: int) -> list[str]:
    """Addresses of 127.0.0.1 that nobody uses at the moment, as `open_transport` takes them."""
    free = free_addresses(count)
    return [LOOPBACK.format(port) if name == "zenoh" else f"{host}:{port}" for host, port in free]


def _host_and_port(address: str) -> tuple[str, int]:
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(
            f'`addresses` of udp must be HOST:PORT, such as "127.0.0.1:7500"; got {address}.'
        )
    return host, int(port)


class Sorted:
    """Part of a transport: messages that begin with a prefix, or all others. The other part gets what is not its own."""

    def __init__(self, transport: Transport, waiting: deque[bytes], other: "deque[bytes]", prefix: bytes, wanted: bool) -> None:  # fmt: skip
        self._transport, self._prefix, self._wanted = transport, prefix, wanted
        self._waiting, self._other = waiting, other

    def broadcast(self, message: bytes) -> None:
        """Sends a message to all others."""
        self._transport.broadcast(message)

    def receive(self, seconds: float) -> bytes | None:
        """The next message of this kind; None if none arrives in time."""
        end = time.monotonic() + seconds
        while True:
            if self._waiting:
                return self._waiting.popleft()
            message = self._transport.receive(max(end - time.monotonic(), 0.0))
            if message is None:
                return None
            mine = message.startswith(self._prefix) == self._wanted
            (self._waiting if mine else self._other).append(message)

    def gone(self) -> frozenset[int]:
        """Numbers of processes that are known to have ended."""
        return self._transport.gone()

    def close(self) -> None:
        """Closes the transport, for both parts."""
        self._transport.close()


def sorted_by(transport: Transport, prefix: bytes) -> tuple[Sorted, Sorted]:
    """The messages of a transport that begin with a prefix, and all others, as two transports.

    Of the kind that nobody is waiting for, the latest are kept.
    """
    mine: deque[bytes] = deque(maxlen=KEPT)
    other: deque[bytes] = deque(maxlen=KEPT)
    return (
        Sorted(transport, mine, other, prefix, True),
        Sorted(transport, other, mine, prefix, False),
    )
