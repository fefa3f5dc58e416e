"""The `deggflow` command."""

import sys

from tyro.extras import SubcommandApp

from deggflow import __version__
from deggflow.jsonl import InputError
from deggflow.studio.command import studio

from .baselines import baselines
from .commands import task_app
from .demo import demo
from .export import export
from .merge import merge
from .registry import SHIPPED, RegisteredEntry, registered
from .reproduce.command import reproduce
from .run import run_app
from .session import BAD_INPUT, SATISFIED, UNFORESEEN
from .start import INTERRUPTED, MESSAGE

_DESCRIPTION = (
    "Generative flow models of several agents that keep hard guarantees: guided generation, "
    "a certificate for every result, and a clear explanation when a requirement can't be met. "
    "`deggflow --version` prints the version."
)


def _app(first: str | None) -> SubcommandApp:
    """All commands.

    A task of another package is imported only if `first`, the first argument, names it: its import takes long.
    """
    app = SubcommandApp()
    app.command(demo)
    for entry in SHIPPED:
        commands = task_app(entry)
        if entry.name == "tabletop":
            commands.command(baselines)
        app.command(commands, name=entry.name, help=entry.help)
    for other in registered([entry.name for entry in SHIPPED]):
        commands = task_app(other) if other.name == first else _placeholder(other)
        app.command(commands, name=other.name, help=other.help)
    app.command(run_app(), name="run", help="One process of a team, for machines of one's own.")
    app.command(merge)
    app.command(export)
    app.command(reproduce)
    app.command(studio)
    return app


def _placeholder(entry: RegisteredEntry) -> SubcommandApp:
    """A task's line in the list of commands, without importing the task."""
    app = SubcommandApp()
    app.command(name="data", help=f"For all commands, see deggflow {entry.name} --help")(lambda: 0)
    return app


def main(arguments: list[str] | None = None) -> None:
    """Runs a command and exits with its code.

    0: every result is satisfied; 2: bad input; 3: some result is not satisfied; 1: any unforeseen error.
    """
    try:
        argv = sys.argv[1:] if arguments is None else arguments
        if any("\0" in argument for argument in argv):
            raise InputError("an argument must not contain a NUL character")
        if argv == ["--version"]:
            print(f"deggflow {__version__}")
            sys.exit(SATISFIED)
        code = _app(next(iter(argv), None)).cli(
            args=argv, prog="deggflow", description=_DESCRIPTION
        )
    except InputError as error:
        print(f"deggflow: {error}", file=sys.stderr)
        code = BAD_INPUT
    except KeyboardInterrupt:
        print(MESSAGE, file=sys.stderr)
        code = INTERRUPTED
    except BrokenPipeError:
        code = UNFORESEEN
    except OSError as error:
        if error.errno is None:
            raise
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"deggflow: {place}{error.strerror}", file=sys.stderr)
        code = BAD_INPUT
    sys.exit(code)
