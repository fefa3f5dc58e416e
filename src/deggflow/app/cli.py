"""The `deggflow` command."""

import sys

from tyro.extras import SubcommandApp

from deggflow.jsonl import InputError

from . import baselines, bridge, demo, tabletop
from .reproduce.command import reproduce
from .session import BAD_INPUT, UNFORESEEN
from .start import INTERRUPTED, MESSAGE

_TABLETOP = SubcommandApp()
_TABLETOP.command(tabletop.data)
_TABLETOP.command(tabletop.train)
_TABLETOP.command(tabletop.generate)
_TABLETOP.command(tabletop.certify)
_TABLETOP.command(tabletop.evaluate)
_TABLETOP.command(baselines.baselines)
_TABLETOP.command(tabletop.render)

_BRIDGE = SubcommandApp()
_BRIDGE.command(bridge.data)
_BRIDGE.command(bridge.train)
_BRIDGE.command(bridge.generate)
_BRIDGE.command(bridge.certify)
_BRIDGE.command(bridge.evaluate)
_BRIDGE.command(bridge.render)

_APP = SubcommandApp()
_APP.command(demo.demo)
_APP.command(
    _TABLETOP, name="tabletop", help="Scenes of objects on a table, each easy to reach and use."
)
_APP.command(_BRIDGE, name="bridge", help="Robots push a plank over a gap and cross it.")
_APP.command(reproduce)

_DESCRIPTION = (
    "Generative flow models of several agents that keep hard guarantees: guided generation, "
    "a certificate for every result, and a clear explanation when a requirement can't be met."
)


def main(arguments: list[str] | None = None) -> None:
    """Runs a command and exits with its code.

    0: every result satisfied; 2: bad input; 3: some result not satisfied; 1: anything unforeseen.
    """
    try:
        if any("\0" in argument for argument in arguments or sys.argv[1:]):
            raise InputError("no argument may hold a NUL character")
        code = _APP.cli(args=arguments, prog="deggflow", description=_DESCRIPTION)
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
