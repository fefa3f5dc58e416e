"""Ctrl-C ends the command in one line and with its exit code, wherever it strikes."""

import os
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


LOOP = """
from deggflow.app.session import prepare_jax
prepare_jax()
import jax, jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.fori_loop(0, 9, lambda k, x: jnp.sin(x) + x[::-1].sum(), x))
print("xla_cpu_small_call" in loop.lower(jnp.ones(1000)).compile().as_text())
"""
OWN = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=0"


@pytest.mark.parametrize(
    ("flags", "as_one"),
    [("", "True"), ("--xla_cpu_enable_fast_math=false", "True"), (OWN, "False")],
    ids=["none", "others", "of the same option"],
)
def test_commands_compile_small_loops_as_one_function_unless_told_otherwise(flags, as_one):
    ended = subprocess.run(
        [sys.executable, "-c", LOOP], env={**os.environ, "XLA_FLAGS": flags},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ended.stdout.strip() == as_one
