"""`deggflow merge`: one file, or one folder of training data, from those of all shards."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

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
        out: File, or folder, of the whole run.
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

    with progress() as bars:
        bar = bars.add_task("merging", total=None)
        lines = merge_shards(
            paths, out, lambda done, total: bars.update(bar, completed=done, total=total)
        )
    console().print(f"{lines} lines of {len(paths)} shards are in {out}.", markup=False)
