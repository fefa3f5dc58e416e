"""What every command shares: compiled programs kept on disk, progress, messages, exit codes."""

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


def cache_folder() -> Path:
    """Where compiled programs are kept between runs (`DEGGFLOW_CACHE`, else the user's cache folder)."""
    named = os.environ.get("DEGGFLOW_CACHE")
    if named:
        return Path(named)
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # an unknown user without a home, as in a container
        base = Path(tempfile.gettempdir())
    return base / "deggflow"


def prepare_jax() -> None:
    """Imports JAX quietly and lets it reuse programs that an earlier run compiled."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    os.environ.setdefault("JAX_PLATFORMS", "")
    import jax

    folder = cache_folder() / "xla"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a read-only home: programs are compiled anew each time
    _renew_what_is_damaged(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # Small programs, too: dozens of them are most of what a second start would compile.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


def _renew_what_is_damaged(folder: Path) -> None:
    """Removes compiled programs once one can't be read; JAX itself warns, and leaves it there for the next run."""
    show = warnings.showwarning

    def shown(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if "writing persistent compilation cache entry" in str(message):
            return  # a full disk, for instance: programs are compiled anew each time
        if "reading persistent compilation cache entry" not in str(message):
            show(message, category, filename, lineno, file, line)
            return
        for entry in folder.glob("*"):
            with suppress(OSError):
                entry.unlink()
        console().print(f"Compiled programs in {folder} were damaged; they are compiled anew.")

    warnings.showwarning = shown


def console() -> "Console":
    """Messages go to stderr; stdout is for results."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def output() -> "Console":
    """Tables on stdout, wide enough to stay whole when they are piped."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 150)


@contextmanager
def progress(*, hidden: bool = False) -> Iterator["Progress"]:
    """Progress bars on stderr, only where somebody watches."""
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
