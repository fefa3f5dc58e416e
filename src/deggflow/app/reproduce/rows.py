"""Rows of a long measurement, kept one by one: an interruption costs one row."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from deggflow.app.runs import resumed_rows
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput
from deggflow.task.formats import Written

from .experiment import Settings

R = TypeVar("R", bound=Written)


def kept_rows(
    settings: Settings,
    name: str,
    identity: Mapping[str, Any],
    jobs: Sequence[Callable[[], R]],
    kind: type[R],
) -> list[R]:
    """The jobs' rows in order; rows that an interrupted call measured are read from its file.

    Args:
        settings: Name the folder of the file; without a folder no rows are kept.
        name: Name of the file.
        identity: JSON values that distinguish these rows from others; a file of other rows is deleted.
        jobs: One function per row, which measures it.
        kind: Dataclass of the rows.
    """
    if settings.folder is None:
        return [job() for job in jobs]
    path = settings.folder / f"{name}.rows.jsonl"
    try:
        ResumableOutput(path, identity)
    except InputError:
        path.unlink()
    return resumed_rows(jobs, kind, identity, path)
