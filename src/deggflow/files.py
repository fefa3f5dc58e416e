"""Files written so that a kill at any moment leaves either the old content or the new one."""

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
    3600  # s without a change, after which a temporary file belongs to a write that was killed
)


def _new_file_mode() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _clean(path: Path) -> None:
    """Removes what killed writes left beside a target."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*{glob.escape(path.suffix)}"):
        try:
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()
        except OSError:
            pass  # somebody else's, or gone already


@contextmanager
def replacing(path: StrPath) -> Iterator[Path]:
    """A temporary file beside the target, with its ending, that takes its place if the block succeeds."""
    path = Path(os.path.realpath(path))  # what a symbolic link names is replaced, not the link
    path.parent.mkdir(parents=True, exist_ok=True)
    _clean(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.fchmod(handle, _new_file_mode())  # mkstemp's own mode is for the owner alone
    os.close(handle)
    try:
        yield Path(name)
        with open(name, "rb") as file:
            os.fsync(file.fileno())
        os.replace(name, path)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = os.fspath(path)  # a failed write does not know of what
        Path(name).unlink(missing_ok=True)
        raise
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_atomically(path: StrPath, content: str | bytes) -> None:
    """Writes beside the target, flushes to disk, and renames over it."""
    with replacing(path) as beside:
        beside.write_bytes(content.encode() if isinstance(content, str) else content)
