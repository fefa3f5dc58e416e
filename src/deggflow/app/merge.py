"""`deggflow merge`: one file, or one folder of training data, from those of all shards."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import tyro

from deggflow.jsonl import InputError

from .session import SATISFIED, console, progress

DATA = ("training.jsonl", "validation.jsonl")  # files of a folder that `data` writes


def merge(
    shards: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="SHARDS", help_behavior_hint=""),
    ],
    out: Path,
) -> int:
    """Join the files of all shards, in any order, into the file that one run without --shard would have written.

    Checks that all shards are of one run and finished, that none is missing or given twice, and that none was changed
    after it was finished.

    Args:
        shards: Files that commands with --shard wrote; or folders, of `data --shard`.
        out: File, or folder, of the whole run. A file that ends in .parquet becomes a table (extra `data`).
    """
    folders = {path.is_dir() for path in shards}
    if len(folders) > 1:
        raise InputError("give files or folders, not both")
    if folders != {True}:
        _merge(shards, out)
        return SATISFIED
    for name in DATA:
        _merge([path / name for path in shards], out / name)
    return SATISFIED


def _merge(paths: Sequence[Path], out: Path) -> None:
    from deggflow.merging import merge_shards
    from deggflow.tables import is_table

    with progress() as bars:
        bar = bars.add_task("merging", total=None)

        def tell(done: int, total: int) -> None:
            bars.update(bar, completed=done, total=total)

        lines = _table(paths, out, tell) if is_table(out) else merge_shards(paths, out, tell)
    console().print(f"{lines} lines of {len(paths)} shards are in {out}.", markup=False)


def _table(paths: Sequence[Path], out: Path, on_progress: Callable[[int, int], None]) -> int:
    from deggflow.jsonl import parse_line
    from deggflow.merging import checked_shards, shard_lines

    from .export import write_table

    if out.exists():
        raise InputError("exists; choose another --out, or remove it first", file=out)
    files = checked_shards(paths)

    def rows() -> Iterator[dict[str, Any]]:
        done = 0
        for file in files:
            for line in shard_lines(file):
                yield parse_line(line.rstrip(b"\n"))
            done += file.part.lines
            on_progress(done, file.part.total)

    return write_table(out, rows(), files[0].settings)
