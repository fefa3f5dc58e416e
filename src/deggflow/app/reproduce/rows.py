"""Rows of a long measurement, kept one by one: what stops it costs one row."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from deggflow.app.runs import Written
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput

from .experiment import Settings


def kept_rows(
    settings: Settings,
    name: str,
    wanted: Mapping[str, Any],
    jobs: Sequence[Callable[[], Written]],
) -> list[Mapping[str, Any]]:
    """The jobs' rows in order; those that an earlier, stopped call measured are taken from its file.

    Args:
        settings: Where rows are kept; nowhere if it names no folder.
        name: Of the file.
        wanted: JSON values that tell these rows from others; rows of others are thrown away.
        jobs: What makes each row.
    """
    if settings.folder is None:
        return [job().to_json() for job in jobs]
    path = settings.folder / f"{name}.rows.jsonl"
    try:
        kept = ResumableOutput(path, wanted)
    except InputError:
        path.unlink()
        kept = ResumableOutput(path, wanted)
    with kept as lines:
        for job in jobs[len(lines.finished) :]:
            row = job().to_json()
            lines.append([row])
            lines.finished.append(row)
        return lines.finished
