"""What carries messages between the processes of a team: a small protocol, and datagrams of the operating system."""

import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol, runtime_checkable

LARGEST = 65_000  # bytes of a datagram, below the limit of UDP


@runtime_checkable
class Transport(Protocol):
    """Carries messages of one agent to all others and back.

    A message may be lost, repeated or overtaken by another one, but it arrives whole or not at all.
    """

    def broadcast(self, message: bytes) -> None:
        """Sends a message to all others; does not wait for them."""

    def receive(self, seconds: float) -> bytes | None:
        """The next message of another agent; None if none arrives in time."""

    def gone(self) -> frozenset[int]:
        """Numbers of agents that are known to have ended since they were first heard."""

    def close(self) -> None:
        """Ends it."""


@runtime_checkable
class DirectTransport(Transport, Protocol):
    """A transport that can also carry a message to one other agent alone."""

    def send(self, number: int, message: bytes) -> None:
        """Sends a message to another agent; does not wait for it."""


class UdpTransport:
    """Datagrams between addresses that all agents know; nothing is encrypted, and nobody else is listened to.

    Meant for processes of one machine. Between machines, use `ZenohTransport` with TLS.
    """

    def __init__(self, number: int, addresses: Sequence[tuple[str, int]]) -> None:
        """Args: number: of this agent; addresses: (host, port) of every agent, by number.

        Raises:
            OSError: The address can't be bound.
        """
        self._others = {k: each for k, each in enumerate(addresses) if k != number}
        self._known = {(_resolved(host), port) for host, port in self._others.values()}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(addresses[number])

    def broadcast(self, message: bytes) -> None:
        """Sends a message to all others.

        Raises:
            ValueError: It does not fit into a datagram.
        """
        for number in self._others:
            self.send(number, message)

    def send(self, number: int, message: bytes) -> None:
        """Sends a message to another agent.

        Raises:
            ValueError: It does not fit into a datagram.
        """
        if len(message) > LARGEST:
            raise ValueError(f"`message` must have at most {LARGEST} bytes; got {len(message)}.")
        # Where nobody is there, or the buffer is full, the message is lost, and will be repeated.
        with suppress(OSError):
            self._socket.sendto(message, self._others[number])

    def receive(self, seconds: float) -> bytes | None:
        """The next message from one of the addresses; None if none arrives in time."""
        end = time.monotonic() + seconds
        while True:
            self._socket.settimeout(max(end - time.monotonic(), 1e-6))
            try:
                data, address = self._socket.recvfrom(LARGEST)
            except TimeoutError:
                return None
            except OSError:  # an earlier message found nobody at its address
                continue
            if address in self._known:
                return data

    def gone(self) -> frozenset[int]:
        """Nobody: datagrams do not tell."""
        return frozenset()

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()


def _resolved(host: str) -> str:
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise OSError(error.errno, f"{host} is not known", None) from None


def free_addresses(count: int) -> list[tuple[str, int]]:
    """Addresses of 127.0.0.1 that nobody uses at the moment, one for each agent of a team."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [("127.0.0.1", each.getsockname()[1]) for each in sockets]
    finally:
        for each in sockets:
            each.close()
