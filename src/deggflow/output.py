"""Writing JSON Lines: a run appends to a file line by line, and a later call of the same run resumes it."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

from .files import StrPath, write_atomically
from .jsonl import MAX_LINE, InputError, parse_line, read_json, shorten
from .locks import locked

ADVICE = "choose another --out, or remove it first"
DIGEST = "sha256"  # key of the digest of a finished shard's lines
Belongs = Callable[[int, Any], bool]
"""(number of a line from 0, its value) -> whether the run would have written it there."""


def settings_path(path: Path) -> Path:
    """Path of the settings of a run, beside its file."""
    return path.with_name(path.name + ".run.json")


def run_settings(path: StrPath) -> dict[str, Any] | None:
    """The settings of the run that wrote a file; None if there are none. Raises `InputError` if they are damaged."""
    try:
        return read_json(settings_path(Path(path)))
    except FileNotFoundError:
        return None


def forget(row: Any) -> None:
    """Ignores a row: an `on_row` for files whose lines are only counted."""


def check_written(*paths: Path | None) -> None:
    """Raises `InputError` if a file that was just said to hold results is gone."""
    for path in paths:
        if path is not None and not path.exists():
            raise InputError("was removed while it was being written", file=path)


class ResumableOutput:
    """A JSON Lines file of one run.

    Beside it lie `<name>.run.json` with the run's settings, which keep other runs out of the file, and `.<name>.lock`,
    which is held while the file is written. A special file, such as /dev/stdout, has neither. The settings of a finished
    shard also hold the digest of its lines, by which `merge_shards` knows that they are complete and unchanged.

    Attributes:
        done: Number of finished lines.
        finished: Their values, if rows are kept.
    """

    def __init__(
        self,
        path: StrPath,
        settings: Mapping[str, Any],
        *,
        count: int | None = None,
        belongs: Belongs | None = None,
        on_row: Callable[[Any], None] | None = None,
    ) -> None:
        """Raises `InputError`, without any change, if the file belongs to another run.

        Args:
            path: The file.
            settings: JSON values that distinguish this run from others.
            count: Number of lines of the run; a longer file belongs to another run. None: any number.
            belongs: Checks the first and the last finished line.
            on_row: Called with every finished line, which is then not kept in `finished` and takes no memory.
        """
        self.path, self.settings = Path(path), dict(settings)
        if self.path.is_dir():
            raise InputError("is a folder; name a file", file=self.path)
        if self.path.suffix == ".parquet":
            raise InputError(
                "names a table, which can't be written line by line; name a .jsonl file, and make a table of it by "
                "`deggflow export`", file=self.path,
            )  # fmt: skip
        self.run = settings_path(self.path)
        self._count, self._belongs, self._on_row = count, belongs, on_row
        self._file: BinaryIO | None = None
        self.done, self.finished = 0, list[Any]()
        self._digest = sha256()
        if self._holds_something():
            self._check_settings()
        self._lock = ExitStack()

    @property
    def _special(self) -> bool:
        return self.path.exists() and not self.path.is_file()

    def _holds_something(self) -> bool:
        return self.path.is_file() and self.path.stat().st_size > 0

    def _check_settings(self) -> None:
        try:
            previous = read_json(self.run)
        except (FileNotFoundError, InputError):
            raise InputError(
                f"exists and was not begun by this command; {ADVICE}", file=self.path
            ) from None
        # A whole run does not continue the file of a shard, although all its own settings are the same.
        for name, value in ({"shard": None} | self.settings).items():
            if previous.get(name) != value:
                raise InputError(
                    f"was begun with {name} = {shorten(previous.get(name))}, not {shorten(value)}; {ADVICE}",
                    file=self.path,
                )

    def __enter__(self) -> "ResumableOutput":
        try:
            if self._special:
                self._file = self.path.open("ab")
                return self
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.enter_context(locked(self.path))
            self._begin()
        except OSError as error:
            self._release()
            raise InputError(f"can't be written: {error.strerror}", file=self.path) from None
        except InputError:
            self._release()
            raise
        return self

    def _begin(self) -> None:
        """With the lock held, checks whose file it is and reads its finished lines."""
        if self._holds_something():
            self._check_settings()
        else:
            write_atomically(self.run, json.dumps(self.settings, indent=2) + "\n")
        self._file = self.path.open("a+b")
        self._file.seek(0)
        end, last = 0, None
        while (line := self._file.readline(MAX_LINE + 2)).endswith(b"\n"):
            last = self._finished_line(line)
            self._digest.update(line)
            end += len(line)
        if last is not None:
            self._check_line(self.done - 1, last)
        if len(line) > MAX_LINE:
            raise InputError(
                f"the line is longer than {MAX_LINE} bytes", file=self.path, line=self.done + 1
            )
        # Cuts off an unfinished line that a kill left.
        self._file.truncate(end)
        self._file.seek(end)

    def _finished_line(self, line: bytes) -> Any:
        try:
            row = parse_line(line.rstrip(b"\n"))
        except InputError as error:
            raise InputError(
                f"was damaged after it was written: {error.reason}; {ADVICE}",
                file=self.path, line=self.done + 1,
            ) from None  # fmt: skip
        if not isinstance(row, dict) or not row:
            raise InputError(
                f"was damaged after it was written: not a result; {ADVICE}",
                file=self.path, line=self.done + 1,
            )  # fmt: skip
        if self.done == 0:
            self._check_line(0, row)
        self.done += 1
        if self._count is not None and self.done > self._count:
            raise InputError(
                f"has more lines than the {self._count} of this run; {ADVICE}", file=self.path
            )
        if self._on_row is None:
            self.finished.append(row)
        else:
            self._on_row(row)
        return row

    def _check_line(self, number: int, row: Any) -> None:
        if self._belongs is not None and not self._belongs(number, row):
            raise InputError(
                f"is not line {number + 1} of this run; {ADVICE}", file=self.path, line=number + 1
            )

    def append(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Writes finished rows and flushes them to disk; raises `InputError` if that fails."""
        self.append_lines([json.dumps(row, allow_nan=False) for row in rows])

    def append_lines(self, lines: Sequence[str]) -> None:
        """As `append`, of rows that are JSON text already."""
        assert self._file is not None
        content = "".join(f"{line}\n" for line in lines).encode()
        try:
            self._file.write(content)
            self._file.flush()
            if self._special:
                return
            os.fsync(self._file.fileno())
            self._check_still_there()
        except OSError as error:
            raise InputError(
                f"can't be written: {error.strerror}; finished lines are kept, rerun the command to resume",
                file=self.path,
            ) from None
        self._digest.update(content)
        self.done += len(lines)

    def _check_still_there(self) -> None:
        """Raises `InputError` unless the open file is the one that its path names."""
        assert self._file is not None
        try:
            on_path, opened = self.path.stat(), os.fstat(self._file.fileno())
        except FileNotFoundError:
            raise InputError("was removed while it was being written", file=self.path) from None
        if (on_path.st_dev, on_path.st_ino) != (opened.st_dev, opened.st_ino):
            raise InputError("was replaced while it was being written", file=self.path)

    def __exit__(self, kind: type[BaseException] | None = None, *_: object) -> None:
        try:
            if kind is None and not self._special:
                self._check_still_there()
                self._seal()
        finally:
            self._release()

    def _seal(self) -> None:
        """Writes the digest of a shard's lines once they are complete."""
        if "shard" in self.settings and self.done == self._count:
            sealed = {**self.settings, DIGEST: self._digest.hexdigest()}
            write_atomically(self.run, json.dumps(sealed, indent=2) + "\n")

    def _release(self) -> None:
        try:
            if self._file is not None:
                self._file.close()
        except OSError:
            pass  # `append` has reported a failed flush
        finally:
            self._file = None
            self._lock.close()
