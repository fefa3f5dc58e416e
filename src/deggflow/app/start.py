"""Entry point of the `deggflow` command: at any moment Ctrl-C ends it with a one-line message."""

import gc
import os
import signal

INTERRUPTED = 130
MESSAGE = "deggflow: interrupted; with --out, rerun the command to resume"
# Objects made until garbage is looked for, by default 700: tracing and records make many that live on, and looking through
# them again and again takes a good part of a command's time.
COLLECT_AFTER = 100_000
SHOW_CURSOR = "\x1b[?25h"  # progress bars hide it


def leave(*_: object) -> None:
    """Handles SIGINT: prints a message and ends the process at once.

    An exception would have to pass through the running code. Callbacks of the garbage collector drop it, extensions
    that are being loaded turn it into another one, and some native code crashes. Files survive this as they survive a
    kill: lines are flushed as they are finished, and everything else is replaced atomically.
    """
    text = SHOW_CURSOR + MESSAGE if os.isatty(2) else MESSAGE
    os.write(2, text.encode() + b"\n")
    os._exit(INTERRUPTED)


def main() -> None:
    """Runs the command."""
    gc.set_threshold(COLLECT_AFTER, *gc.get_threshold()[1:])
    # It is ignored in the background jobs of a shell.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, leave)
    try:
        from .cli import main as run

        run()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the interpreter's own exit remains
        gc.freeze()  # which would look through all that is left


if __name__ == "__main__":
    main()
