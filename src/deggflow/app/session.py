"""Shared by all commands: the cache of compiled programs, progress bars, messages, exit codes."""

import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

SATISFIED, UNFORESEEN, BAD_INPUT, NOT_SATISFIED = 0, 1, 2, 3

# Bytes: XLA compiles a loop that accesses fewer in an iteration as one function. In loops of larger programs, each of the
# hundreds of kernels of an iteration costs more to start than to run (docs/performance.md).
SMALL_LOOP = 1_000_000


def cache_folder() -> Path:
    """Where compiled programs are kept between runs (`DEGGFLOW_CACHE`, else the user's cache folder)."""
    override = os.environ.get("DEGGFLOW_CACHE")
    if override:
        return Path(override)
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # an unknown user without a home folder, as in a container
        base = Path(tempfile.gettempdir())
    return base / "deggflow"


def prepare_jax() -> None:
    """Imports JAX quietly, compiles loops of single samples as one function, and reuses what an earlier run compiled."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    os.environ.setdefault("JAX_PLATFORMS", "")
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_backend_extra_options" not in flags:  # the user's own stay
        loops = f"--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold={SMALL_LOOP}"
        os.environ["XLA_FLAGS"] = f"{flags} {loops}".strip()
    import jax

    folder = cache_folder() / "xla"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a read-only home folder: programs are compiled each time
    _clear_damaged_cache(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # Small programs are cached, too: dozens of them make up most of the compilation at a second start.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


def _clear_damaged_cache(folder: Path) -> None:
    """Removes all compiled programs once one can't be read; JAX itself only warns at every run."""
    show = warnings.showwarning

    def showwarning(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if "writing persistent compilation cache entry" in str(message):
            return  # a full disk, for instance: programs are compiled each time
        if "reading persistent compilation cache entry" not in str(message):
            show(message, category, filename, lineno, file, line)
            return
        for entry in folder.glob("*"):
            with suppress(OSError):
                entry.unlink()
        console().print(f"Compiled programs in {folder} were damaged; they are compiled again.")

    warnings.showwarning = showwarning


def console() -> "Console":
    """The console for messages, on stderr; stdout is for results."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def output() -> "Console":
    """The console for results, on stdout; text is wrapped at 150 characters where that is no terminal."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 150)


@contextmanager
def progress(*, hidden: bool = False) -> Iterator["Progress"]:
    """Progress bars on stderr, only if it is a terminal."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(), disable=hidden or not sys.stderr.isatty()) as bars:
        yield bars
