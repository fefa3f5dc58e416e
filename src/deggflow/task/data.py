"""Demonstrations written to a folder; an interrupted call can be completed."""

from collections.abc import Callable
from pathlib import Path

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget

from .model import AbstractModel, Part, parts
from .options import Recipe, check_range

Progress = Callable[[int, int], None]
"""(demonstrations written, demonstrations in all)."""


def write_data(
    model: AbstractModel,
    folder: StrPath,
    recipe: Recipe,
    on_progress: Progress = lambda count, total: None,
) -> None:
    """Writes `training.jsonl` and `validation.jsonl`, or completes the files of an interrupted call.

    Args:
        model: Makes the demonstrations.
        folder: Folder that receives both files.
        recipe: Number, sizes and seed of the demonstrations.
        on_progress: Called after each chunk.

    Raises:
        InputError: A file belongs to another recipe, another process is writing it, it can't be written, or it was removed.
    """
    for size in recipe.sizes:
        check_range("sizes", size, *model.sizes)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    total = len(recipe.sizes) * (recipe.training + recipe.validation)
    before = 0
    for part in parts(recipe):
        _write_part(
            model,
            folder,
            recipe,
            part,
            lambda count, before=before: on_progress(before + count, total),
        )
        before += len(recipe.sizes) * part.each
    for part in parts(recipe):  # the first file may be removed while the second is written
        if not _path(folder, part).exists():
            raise InputError("was removed while the data were written", file=_path(folder, part))


def _path(folder: Path, part: Part) -> Path:
    return folder / f"{part.name}.jsonl"


def _write_part(
    model: AbstractModel,
    folder: Path,
    recipe: Recipe,
    part: Part,
    on_progress: Callable[[int], None],
) -> None:
    lines = part.each * len(recipe.sizes)
    with ResumableOutput(
        _path(folder, part), recipe.to_json(), count=lines, on_row=forget
    ) as output:
        lines_before = output.done
        on_progress(lines_before)
        for position, size in enumerate(recipe.sizes):
            have = min(max(0, lines_before - position * part.each), part.each)
            # A chunk that a kill cut in two is made again as a whole: a batch of another size rounds differently.
            for start in range(have // model.chunk * model.chunk, part.each, model.chunk):
                count = min(model.chunk, part.each - start)
                if start + count <= have:
                    continue
                rows = model.demonstrate(size, start, count, recipe, part.seed)
                output.append(rows[max(0, have - start) :])
                on_progress(output.done)
