"""Where the `deggflow` command begins: Ctrl-C ends it in one line from its first moment on."""

import sys

INTERRUPTED = 130
MESSAGE = "deggflow: interrupted; with --out, rerun the command to resume"


def main() -> None:
    """Runs the command."""
    try:
        from .cli import main as run

        run()
    except KeyboardInterrupt:
        print(MESSAGE, file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
