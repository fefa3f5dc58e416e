"""Locks: only one process at a time may write a file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from .jsonl import InputError


@contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Holds `.<name>.lock` beside a file, whose folder must exist, for as long as the block runs.

    Args:
        path: The file.
        wait: Waits until no other process holds it.

    Raises:
        InputError: Another process holds it.
        OSError: The lock can't be made.
    """
    lock = FileLock(path.with_name(f".{path.name}.lock"))
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except Timeout:
        raise InputError("another run is writing it", file=path) from None
    try:
        yield
    finally:
        lock.release()
