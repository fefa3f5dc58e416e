"""Ends a process when the one that started it has ended, however that happened."""

import os
import signal
import sys
from threading import Thread

CHILD = "DEGGFLOW_CHILD"
"""Environment variable of processes that end with the one that started them."""

_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux


def end_with_parent() -> None:
    """Ends this process once its standard input is closed, which its parent holds open.

    On Linux the kernel also kills it with its parent: a process that is stopped reads no input.
    """
    parent = os.getppid()
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
    Thread(target=_wait_for_end, daemon=True).start()


def _wait_for_end() -> None:
    while os.read(0, 1024):
        pass
    os._exit(1)
