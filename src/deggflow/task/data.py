"""Demonstrations written to a folder; an interrupted call can be completed."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget
from deggflow.shards import Shard

from .model import AbstractModel, Part, parts
from .options import Recipe, check_range

Progress = Callable[[int, int], None]
"""(demonstrations written, demonstrations in all)."""


def write_data(
    model: AbstractModel,
    folder: StrPath,
    recipe: Recipe,
    on_progress: Progress = lambda count, total: None,
    *,
    shard: Shard | None = None,
) -> None:
    """Writes `training.jsonl` and `validation.jsonl`, or completes the files of an interrupted call.

    Args:
        model: Makes the demonstrations.
        folder: Folder that receives both files.
        recipe: Number, sizes and seed of the demonstrations.
        on_progress: Called after each chunk.
        shard: Writes only this part of each file's lines; None: all.

    Raises:
        InputError: A file belongs to another recipe, another process is writing it, it can't be written, or it was removed.
    """
    for size in recipe.sizes:
        check_range("sizes", size, *model.sizes)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    todo = [(part, _chunks(model, recipe, part)) for part in parts(recipe)]
    mine = [
        (shard or Shard(1, 1)).part([each.demonstrations for each in chunks]) for _, chunks in todo
    ]
    total, before = sum(each.lines for each in mine), 0
    for (part, chunks), own in zip(todo, mine, strict=True):
        settings = recipe.to_json() | ({} if shard is None else shard.settings(own))

        def tell(count: int, before: int = before) -> None:
            on_progress(before + count, total)

        with ResumableOutput(
            _path(folder, part), settings, count=own.lines, on_row=forget
        ) as output:
            _write(output, model, recipe, part, (shard or Shard(1, 1)).of_chunks(chunks), tell)
        before += own.lines
    for part in parts(recipe):  # the first file may be removed while the second is written
        if not _path(folder, part).exists():
            raise InputError("was removed while the data were written", file=_path(folder, part))


class Chunk(NamedTuple):
    """Demonstrations that are made together.

    Attributes:
        size: Their number of agents.
        first: Number of the first one among those of its size.
        demonstrations: How many.
    """

    size: int
    first: int
    demonstrations: int


def _path(folder: Path, part: Part) -> Path:
    return folder / f"{part.name}.jsonl"


def _chunks(model: AbstractModel, recipe: Recipe, part: Part) -> list[Chunk]:
    """The chunks of a file in order."""
    return [
        Chunk(size, start, min(model.chunk, part.each - start))
        for size in recipe.sizes
        for start in range(0, part.each, model.chunk)
    ]


def _write(
    output: ResumableOutput,
    model: AbstractModel,
    recipe: Recipe,
    part: Part,
    chunks: Sequence[Chunk],
    on_progress: Callable[[int], None],
) -> None:
    have, end = output.done, 0
    on_progress(have)
    for chunk in chunks:
        start, end = end, end + chunk.demonstrations
        if end <= have:
            continue
        # A chunk that a kill cut in two is made again as a whole: a batch of another size rounds differently.
        rows = model.demonstrate(chunk.size, chunk.first, chunk.demonstrations, recipe, part.seed)
        output.append(rows[max(0, have - start) :])
        on_progress(output.done)
