"""Demonstrations written to a folder; an interrupted call can be completed."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget
from deggflow.shards import Shard

from .model import AbstractModel, Part, parts
from .options import Recipe, check_range

Progress = Callable[[int, int], None]
"""(demonstrations written, demonstrations in all)."""


class Chunk(NamedTuple):
    """Demonstrations that are made together.

    Attributes:
        size: Their number of agents.
        first: Number of the first one among those of its size.
        demonstrations: How many.
        seed: Seed of their part of the data.
    """

    size: int
    first: int
    demonstrations: int
    seed: int


Demonstrator = Callable[[Iterable[Chunk]], Iterable[Sequence[Mapping[str, Any]]]]
"""Makes the lines of each chunk, in order."""


def write_data(
    model: AbstractModel,
    folder: StrPath,
    recipe: Recipe,
    on_progress: Progress = lambda count, total: None,
    *,
    shard: Shard | None = None,
    demonstrator: Demonstrator | None = None,
) -> None:
    """Writes `training.jsonl` and `validation.jsonl`, or completes the files of an interrupted call.

    Args:
        model: Makes the demonstrations.
        folder: Folder that receives both files.
        recipe: Number, sizes and seed of the demonstrations.
        on_progress: Called after each chunk.
        shard: Writes only this part of each file's lines; None: all.
        demonstrator: Makes the chunks' lines; None: the model, in this process.

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
    demonstrator = demonstrator or _by(model, recipe)
    for (part, chunks), own in zip(todo, mine, strict=True):
        settings = recipe.to_json() | ({} if shard is None else shard.settings(own))

        def tell(count: int, before: int = before) -> None:
            on_progress(before + count, total)

        with ResumableOutput(
            _path(folder, part), settings, count=own.lines, on_row=forget
        ) as output:
            _write(output, demonstrator, (shard or Shard(1, 1)).of_chunks(chunks), tell)
        before += own.lines
    for part in parts(recipe):  # the first file may be removed while the second is written
        if not _path(folder, part).exists():
            raise InputError("was removed while the data were written", file=_path(folder, part))


def _path(folder: Path, part: Part) -> Path:
    return folder / f"{part.name}.jsonl"


def _chunks(model: AbstractModel, recipe: Recipe, part: Part) -> list[Chunk]:
    """The chunks of a file in order."""
    return [
        Chunk(size, start, min(model.chunk, part.each - start), part.seed)
        for size in recipe.sizes
        for start in range(0, part.each, model.chunk)
    ]


def _by(model: AbstractModel, recipe: Recipe) -> Demonstrator:
    def demonstrator(chunks: Iterable[Chunk]) -> Iterator[Sequence[Mapping[str, Any]]]:
        for size, first, count, seed in chunks:
            yield model.demonstrate(size, first, count, recipe, seed)

    return demonstrator


def _write(
    output: ResumableOutput,
    demonstrator: Demonstrator,
    chunks: Sequence[Chunk],
    on_progress: Callable[[int], None],
) -> None:
    on_progress(output.done)
    ends = accumulate(chunk.demonstrations for chunk in chunks)
    # A chunk that a kill cut in two is made again as a whole: a batch of another size rounds differently.
    left = [(chunk, end) for chunk, end in zip(chunks, ends, strict=True) if end > output.done]
    made = demonstrator(chunk for chunk, _ in left)
    for (_, end), rows in zip(left, made, strict=True):
        output.append(rows[len(rows) - (end - output.done) :])
        on_progress(output.done)
