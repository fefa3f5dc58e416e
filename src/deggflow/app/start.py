"""Where the `deggflow` command begins: Ctrl-C ends it in one line, from its first moment to its last."""

import os
import signal
import sys
from types import TracebackType
from typing import Protocol

INTERRUPTED = 130
MESSAGE = "deggflow: interrupted; with --out, rerun the command to resume"


class Unraisable(Protocol):
    """What Python hands to `sys.unraisablehook`."""

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

    def unraisable(lost: Unraisable) -> None:
        """Python drops what is raised in a callback of its garbage collector, Ctrl-C included."""
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            show(lost)  # type: ignore[arg-type]
            return
        print(MESSAGE, file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)  # files are as safe as from a kill

    if (
        signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    ):  # as it is for a shell's background jobs
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = unraisable
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
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left but to leave


if __name__ == "__main__":
    main()
