"""Entry point of the `deggflow` command: at any moment Ctrl-C ends it with a one-line message."""

import os
import signal
import sys
from types import TracebackType
from typing import Protocol

INTERRUPTED = 130
MESSAGE = "deggflow: interrupted; with --out, rerun the command to resume"


class Unraisable(Protocol):
    """The argument of `sys.unraisablehook`."""

    exc_type: type[BaseException]
    exc_value: BaseException | None
    exc_traceback: TracebackType | None


def main() -> None:
    """Runs the command."""
    show = sys.unraisablehook

    def hook(unraisable: Unraisable) -> None:
        """Python drops exceptions in callbacks of its garbage collector, including Ctrl-C."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            show(unraisable)  # type: ignore[arg-type]
            return
        print(MESSAGE, file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)  # files survive this as they survive a kill

    sys.unraisablehook = hook
    try:
        from .cli import main as run

        run()
    except KeyboardInterrupt:
        print(MESSAGE, file=sys.stderr)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process is ending


if __name__ == "__main__":
    main()
