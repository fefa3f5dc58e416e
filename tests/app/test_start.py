"""Ctrl-C ends the command in one line and with its exit code, wherever it strikes."""

import subprocess
import sys

import pytest

STRIKES = {
    "in the command": "os.kill(os.getpid(), signal.SIGINT); time.sleep(600)",
    "in a callback of the garbage collector": "gc.callbacks.append(strike); gc.collect(); time.sleep(600)",
    "while an extension is loaded": "load()",
    "in a finaliser": "Dying(); time.sleep(600)",
}
SCRIPT = """
import gc, os, signal, time
from deggflow.app import cli, start

def strike(*_):
    gc.callbacks.clear()
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(600)

class Dying:
    __del__ = strike

def load():
    try:
        strike()
    except KeyboardInterrupt:
        raise ImportError("Encountered an error while initializing the extension.")

def command():
    {what}

cli.main = command
start.main()
"""


@pytest.mark.parametrize("where", STRIKES)
def test_an_interrupt_is_told_in_one_line(where):
    script = SCRIPT.format(what=STRIKES[where])
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 130
    assert ended.stderr == "deggflow: interrupted; with --out, rerun the command to resume\n"


def test_once_a_command_has_ended_nothing_interrupts_its_end():
    """JAX clears its backends when Python leaves."""
    late = "atexit.register(strike)"
    script = SCRIPT.replace("{what}", late).replace("import gc", "import atexit, gc")
    script = script.replace("    time.sleep(600)\n\nclass", "    time.sleep(0.1)\n\nclass")
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")
