"""Atomic writing: a kill at any moment leaves either the old content of a file or the new one."""

import glob
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

StrPath = str | os.PathLike[str]
"""Name of a file or folder, as every function of the library takes it."""


ABANDONED = (
    3600  # s without a change, after which a temporary file counts as left by a killed write
)


def _new_file_mode() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _clean(path: Path) -> None:
    """Removes temporary files that killed writes left beside a target."""
    for leftover in path.parent.glob(f".{glob.escape(path.name)}.*{glob.escape(path.suffix)}"):
        try:
            if time.time() - leftover.stat().st_mtime > ABANDONED:
                leftover.unlink()
        except OSError:
            pass  # of another user, or removed already


@contextmanager
def replacing(path: StrPath) -> Iterator[Path]:
    """A temporary file beside the target, with its suffix, that replaces the target if the block succeeds."""
    path = Path(os.path.realpath(path))  # replaces the target of a symbolic link, not the link
    path.parent.mkdir(parents=True, exist_ok=True)
    _clean(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.fchmod(handle, _new_file_mode())  # mkstemp gives access to the owner only
    os.close(handle)
    try:
        yield Path(name)
        with open(name, "rb") as file:
            os.fsync(file.fileno())
        os.replace(name, path)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = os.fspath(path)  # a failed write does not name its file
        Path(name).unlink(missing_ok=True)
        raise
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_atomically(path: StrPath, content: str | bytes) -> None:
    """Writes to a temporary file, flushes it to disk and renames it to the target."""
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
