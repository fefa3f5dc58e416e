"""How much one page may ask for."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic

MAX_MESSAGE = 4 << 20  # bytes
MAX_PAGES = 8  # that are connected to one desk at once
MAX_REQUESTS = 64  # that are answered at once, websockets included
MAX_WAITING = 16  # messages of one page that wait for an answer
RATE, BURST = 60.0, 120.0  # messages of one page: each second, and at once


@dataclass
class RateLimit:
    """Allows `rate` events each second, and `burst` at once after a pause.

    Attributes:
        rate: Events each second.
        burst: Events at once.
        clock: Seconds.
    """

    rate: float = RATE
    burst: float = BURST
    clock: Callable[[], float] = monotonic
    _left: float = field(init=False)
    _since: float = field(init=False)

    def __post_init__(self) -> None:
        self._left, self._since = self.burst, self.clock()

    def allows(self) -> bool:
        """Counts one event; False if there were too many."""
        now = self.clock()
        self._left = min(self.burst, self._left + (now - self._since) * self.rate)
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True
