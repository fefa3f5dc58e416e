"""Joining the files of all shards into the file of the whole run, checked: nothing missing, nothing double."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from .files import StrPath, replacing, write_atomically
from .jsonl import InputError, expect_integer, expect_object, expect_text, read_json, shorten
from .output import DIGEST, settings_path
from .shards import Part, Shard

Progress = Callable[[int, int], None]
"""(lines joined, lines in all)."""
_OF_SHARD = ("shard", "part", DIGEST)  # settings that the shards of one run do not share
_BLOCK = 1 << 20  # bytes


class ShardFile(NamedTuple):
    """A finished file of one shard.

    Attributes:
        path: The file.
        shard: Which shard it is.
        part: Which lines of the run it holds.
        digest: SHA-256 of its content when it was finished.
        settings: Settings of the whole run.
    """

    path: Path
    shard: Shard
    part: Part
    digest: str
    settings: dict[str, Any]


def read_shard(path: StrPath) -> ShardFile:
    """What the settings beside a shard's file say. Raises `InputError` if it is none, or is not finished."""
    path = Path(path)
    place = settings_path(path)
    try:
        settings = read_json(place)
    except FileNotFoundError:
        raise InputError("is no file of a run; its settings are missing", file=path) from None
    if "shard" not in settings:
        raise InputError("is no shard: it was not written with --shard", file=path)
    if DIGEST not in settings:
        raise InputError("is not finished; rerun its command to resume", file=path)
    try:
        shard = Shard.parse(expect_text(settings["shard"], "shard"))
        part = expect_object(settings.get("part"), "part", Part._fields, Part._fields)
        lines = Part(*(expect_integer(part[k], f"part.{k}", 0, 2**53) for k in Part._fields))
        digest = expect_text(settings[DIGEST], DIGEST)
    except InputError as error:
        raise InputError(error.reason, file=place, field=error.field) from None
    rest = {name: value for name, value in settings.items() if name not in _OF_SHARD}
    return ShardFile(path, shard, lines, digest, rest)


def checked_shards(paths: Sequence[StrPath]) -> list[ShardFile]:
    """The shards of one run in order.

    Args:
        paths: Their files, in any order.

    Raises:
        InputError: A file is no finished shard, belongs to another run, or holds the same shard as another; or one is missing.
    """
    files = sorted(map(read_shard, paths), key=lambda file: file.shard.number)
    if not files:
        raise InputError("give the files of all shards")
    first = files[0]
    for file in files:
        whole = {"shards": file.shard.of, "lines": file.part.total, **file.settings}
        other = {"shards": first.shard.of, "lines": first.part.total, **first.settings}
        for name in dict.fromkeys((*whole, *other)):
            if whole.get(name) != other.get(name):
                here, there = shorten(whole.get(name)), shorten(other.get(name))
                raise InputError(
                    f"is of another run than {first.path}: {name} = {here}, not {there}",
                    file=file.path,
                )
    by_number: dict[int, Path] = {}
    for file in files:
        if file.shard.number in by_number:
            raise InputError(
                f"holds shard {file.shard}, as {by_number[file.shard.number]} does", file=file.path
            )
        by_number[file.shard.number] = file.path
    missing = [k for k in range(1, first.shard.of + 1) if k not in by_number]
    if missing:
        text = shorten(", ".join(map(str, missing)))
        raise InputError(f"{len(missing)} of {first.shard.of} shards are missing: {text}")
    begin = 0
    for file in files:
        if file.part.first != begin:
            raise InputError(
                f"begins with line {file.part.first + 1} of the run, not {begin + 1}",
                file=file.path,
            )
        begin += file.part.lines
    return files


def shard_lines(file: ShardFile) -> Iterator[bytes]:
    """The lines of a shard; raises `InputError` after the last one if they are not those that it was finished with."""
    digest, count = sha256(), 0
    with file.path.open("rb") as content:
        for line in content:
            digest.update(line)
            count += 1
            yield line
    _check(file, digest.hexdigest(), count)


def _check(file: ShardFile, digest: str, lines: int) -> None:
    if lines != file.part.lines or digest != file.digest:
        raise InputError(
            f"was changed after it was finished: it holds {lines} lines, of {file.part.lines}, and its digest "
            f"{'matches' if digest == file.digest else 'does not match'}",
            file=file.path,
        )


def merge_shards(
    paths: Sequence[StrPath], out: StrPath, on_progress: Progress = lambda done, total: None
) -> int:
    """Joins the files of all shards of a run; the result is the file of the run without shards, with its settings.

    Args:
        paths: Files of all shards, in any order.
        out: The file of the whole run. It appears once everything is checked.
        on_progress: Called after each shard.

    Raises:
        InputError: As for `checked_shards`; or a shard was changed after it was finished; or `out` exists.

    Returns:
        The number of lines.
    """
    files, done = checked_shards(paths), 0
    with merged(out, files) as temporary, temporary.open("wb") as target:
        for file in files:
            _append(file, target)
            done += file.part.lines
            on_progress(done, file.part.total)
    return done


def _append(file: ShardFile, target: Any) -> None:
    digest, lines = sha256(), 0
    with file.path.open("rb") as content:
        while block := content.read(_BLOCK):
            digest.update(block)
            lines += block.count(b"\n")
            target.write(block)
    _check(file, digest.hexdigest(), lines)


@contextmanager
def merged(out: StrPath, files: Sequence[ShardFile]) -> Iterator[Path]:
    """A temporary file that becomes `out`, with the settings of the whole run beside it, if the block succeeds."""
    out = Path(out)
    if out.exists():
        raise InputError("exists; choose another --out, or remove it first", file=out)
    with replacing(out) as temporary:
        yield temporary
        write_atomically(settings_path(out), json.dumps(files[0].settings, indent=2) + "\n")
