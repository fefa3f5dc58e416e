"""Checkpoints of a training run: the last two, each a safetensors file that is written atomically."""

import re
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from deggflow.jsonl import InputError
from deggflow.weights import load_arrays, save_arrays

T = TypeVar("T")

KEPT = 2  # checkpoints
_NAME = re.compile(r"([1-9][0-9]{0,9})\.safetensors")


def _steps(folder: Path) -> list[int]:
    names = (_NAME.fullmatch(path.name) for path in folder.glob("*.safetensors"))
    return sorted(int(name[1]) for name in names if name)


def last_step(folder: Path) -> int:
    """The step of the last checkpoint, 0 if there is none."""
    return max(_steps(folder), default=0)


def save(folder: Path, step: int, state: object, run: str) -> None:
    """Writes a checkpoint of a run, then removes those older than the last two."""
    save_arrays(folder / f"{step}.safetensors", state, f"{run} {step}")
    for old in _steps(folder)[:-KEPT]:
        (folder / f"{old}.safetensors").unlink(missing_ok=True)


def remove(folder: Path, step: int) -> None:
    """Removes a checkpoint, and the folder if it was the only one."""
    (folder / f"{step}.safetensors").unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def restore(folder: Path, step: int, like: T, run: str) -> T:
    """The state of a checkpoint.

    Raises:
        InputError: The checkpoint is damaged, or belongs to another run or step.
    """
    try:
        return load_arrays(folder / f"{step}.safetensors", like, f"{run} {step}")
    except InputError as error:
        raise InputError(
            f"{error.reason}; remove it to resume from the previous checkpoint", file=error.file
        ) from None
