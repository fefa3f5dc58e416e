"""Rows of a long measurement, kept one by one: what stops it costs one row."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from deggflow.app.runs import resumed_rows
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput
from deggflow.task.interface import Written

from .experiment import Settings

R = TypeVar("R", bound=Written)


def kept_rows(
    settings: Settings,
    name: str,
    wanted: Mapping[str, Any],
    jobs: Sequence[Callable[[], R]],
    kind: type[R],
) -> list[R]:
    """The jobs' rows in order; those that an earlier, stopped call measured are taken from its file.

    Args:
        settings: Where rows are kept; nowhere if it names no folder.
        name: Of the file.
        wanted: JSON values that tell these rows from others; rows of others are thrown away.
        jobs: What makes each row.
        kind: A dataclass, which the rows are of.
    """
    if settings.folder is None:
        return [job() for job in jobs]
    path = settings.folder / f"{name}.rows.jsonl"
    try:
        ResumableOutput(path, wanted)
    except InputError:
        path.unlink()
    return resumed_rows(jobs, kind, wanted, path)
