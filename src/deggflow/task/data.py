"""Demonstrations written to a folder: completed after a kill, and there when it is said that they are."""

from collections.abc import Callable
from pathlib import Path

from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget

from .model import AbstractModel, Part, parts
from .options import Recipe, check_range

Progress = Callable[[int, int], None]
"""(demonstrations there, demonstrations in all)."""


def write_data(
    model: AbstractModel,
    folder: StrPath,
    recipe: Recipe,
    on_progress: Progress = lambda done, total: None,
) -> None:
    """Writes `training.jsonl` and `validation.jsonl`, or completes what an interrupted call left there.

    Args:
        model: Makes the demonstrations.
        folder: Receives both files.
        recipe: What is made.
        on_progress: Called after each chunk.

    Raises:
        InputError: A file belongs to another recipe, is written by another process, can't be written or was removed.
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
            lambda done, before=before: on_progress(before + done, total),
        )
        before += len(recipe.sizes) * part.each
    for part in parts(recipe):  # the first may have gone while the second was written
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
        resumed = output.done
        on_progress(resumed)
        for position, size in enumerate(recipe.sizes):
            have = min(max(0, resumed - position * part.each), part.each)
            # A chunk that a kill cut in two is made again whole, as another batch rounds differently.
            for start in range(have // model.chunk * model.chunk, part.each, model.chunk):
                count = min(model.chunk, part.each - start)
                if start + count <= have:
                    continue
                rows = model.demonstrate(size, start, count, recipe, part.seed)
                output.append(rows[max(0, have - start) :])
                on_progress(output.done)
