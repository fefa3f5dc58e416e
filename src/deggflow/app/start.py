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
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    show = sys.unraisablehook

    def hook(unraisable: Unraisable) -> None:
        """Python drops exceptions in callbacks of its garbage collector, including Ctrl-C."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            show(unraisable)  # type: ignore[arg-type]
            return
        print(MESSAGE, file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)  # files survive this as they survive a kill

    # It is ignored in the background jobs of a shell.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = hook
    try:
        from .cli import main as run

        run()
    except (Exception, KeyboardInterrupt):
        if not interrupted:
            raise
        # Whatever it became: an extension that is interrupted while it is loaded raises ImportError.
        print(MESSAGE, file=sys.stderr)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process is ending


if __name__ == "__main__":
    main()
