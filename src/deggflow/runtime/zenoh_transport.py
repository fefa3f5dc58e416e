"""Messages by Eclipse Zenoh, peer to peer: what rmw_zenoh of ROS 2 speaks. Needs the extra `deggflow[runtime]`."""

import json
import queue
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .agreement import TeamError

LOOPBACK = "tcp/127.0.0.1:{}"


class ZenohTransport:
    """Peers that connect to one another at addresses that all of them know; nobody is looked for by multicast.

    Agent k publishes under `<prefix>/message/<k>`, is told what is for it alone under `<prefix>/to/<k>`, and holds the liveliness token `<prefix>/alive/<k>`, which others see vanish
    when its process ends.
    """

    def __init__(
        self,
        number: int,
        endpoints: Sequence[str],
        *,
        prefix: str = "deggflow",
        config: Path | None = None,
    ) -> None:
        """Opens a session that listens at one's own endpoint and connects to those of all others.

        Args:
            number: Of this agent.
            endpoints: Of every agent by number, such as "tcp/127.0.0.1:7501" or "tls/robot-3.local:7501".
            prefix: Of the keys; teams that share a network have different ones.
            config: File of Zenoh's settings in JSON5, to which endpoints are added: TLS, access control, and so on.

        Raises:
            ImportError: Zenoh is not installed.
            TeamError: The session can't be opened.
        """
        try:
            import zenoh
        except ImportError as error:
            raise ImportError(
                "Zenoh is not installed; `pip install deggflow[runtime]` has it."
            ) from error
        self._received: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._gone: set[int] = set()
        settings = zenoh.Config() if config is None else zenoh.Config.from_file(str(config))
        for key, value in self._settings(number, endpoints).items():
            settings.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(settings)
        except zenoh.ZError as error:
            raise TeamError(f"Zenoh can't listen at {endpoints[number]}: {error}") from error
        own, alive = f"{prefix}/message/{number}", f"{prefix}/alive"
        self._publisher = self._session.declare_publisher(
            own, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._subscriber = self._session.declare_subscriber(f"{prefix}/message/*", self._take)
        self._vanished = zenoh.SampleKind.DELETE
        liveliness = self._session.liveliness()
        self._token = liveliness.declare_token(f"{alive}/{number}")
        self._tokens = liveliness.declare_subscriber(f"{alive}/*", self._watch)
        self._direct = self._session.declare_subscriber(f"{prefix}/to/{number}", self._take)
        self._own, self._prefix, self._blocking = own, prefix, zenoh.CongestionControl.BLOCK

    @staticmethod
    def _settings(number: int, endpoints: Sequence[str]) -> dict[str, Any]:
        return {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [endpoints[number]],
            # One link for each pair: the later agent connects, again and again until the other is there.
            "connect/endpoints": list(endpoints[:number]),
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
        }

    def _take(self, sample: Any) -> None:
        if str(sample.key_expr) != self._own:
            self._received.put(sample.payload.to_bytes())

    def _watch(self, sample: Any) -> None:
        number = int(str(sample.key_expr).rpartition("/")[2])
        if sample.kind == self._vanished:
            self._gone.add(number)
        else:  # it may have been started again
            self._gone.discard(number)

    def broadcast(self, message: bytes) -> None:
        """Sends a message to all others."""
        self._publisher.put(message)

    def send(self, number: int, message: bytes) -> None:
        """Sends a message to another agent."""
        key = f"{self._prefix}/to/{number}"
        self._session.put(key, message, congestion_control=self._blocking)

    def receive(self, seconds: float) -> bytes | None:
        """The next message of another agent; None if none arrives in time."""
        try:
            return (
                self._received.get(timeout=seconds) if seconds > 0 else self._received.get_nowait()
            )
        except queue.Empty:
            return None

    def gone(self) -> frozenset[int]:
        """Agents whose tokens have vanished."""
        return frozenset(self._gone)

    def close(self) -> None:
        """Closes the session."""
        self._session.close()
