"""`deggflow export`: results as a Parquet table, and back as JSON Lines."""

import json
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

import tyro

from deggflow.jsonl import MAX_LINE, InputError, parse_line, quoted

from .registry import SHIPPED, ShippedEntry, entry_named
from .session import SATISFIED, console, prepare_jax

DATA = ("training", "validation")  # files of a folder that `data` writes


def export(
    file: Annotated[Path, tyro.conf.Positional],
    out: Path,
    task: str | None = None,
    lerobot: bool = False,
) -> int:
    """Write results, or training data, as a Parquet table; or a table as JSON Lines.

    Args:
        file: File of results, as `generate` writes it, or a table; or a folder of training data.
        out: File that receives them: a table if it ends in .parquet, else JSON Lines. For a folder: a folder, which receives tables.
        task: Name of the task, if neither the settings beside the file nor its keys tell.
        lerobot: Write trials or plans as a LeRobot data set (layout v3.0) into the folder --out.
    """
    if lerobot:
        return _export_episodes(file, out)
    if not file.is_dir():
        _export(file, out, task)
        return SATISFIED
    for name in DATA:
        _export(file / f"{name}.jsonl", out / f"{name}.parquet", task)
    return SATISFIED


def _export(file: Path, out: Path, task: str | None) -> None:
    from deggflow.files import replacing
    from deggflow.output import run_settings, settings_path
    from deggflow.tables import is_table, read_info, table_rows

    if out.exists():
        raise InputError("exists; choose another --out, or remove it first", file=out)
    if is_table(file):
        about = dict(read_info(file).about)
        entry = entry_named(task or str(about.get("task")))
        from deggflow.tables.parquet import kind_of

        rows = table_rows(file, kind_of(file, entry.load_lines()))
        settings = about.get("run") or {}
    else:
        rows = read_rows(file)
        settings = run_settings(file) or {}
    if is_table(out):
        count = write_table(out, rows, settings, task)
    else:
        count = 0
        with replacing(out) as temporary, temporary.open("w", encoding="utf-8") as lines:
            for row in rows:
                lines.write(json.dumps(row, allow_nan=False) + "\n")
                count += 1
        if settings:
            from deggflow.files import write_atomically

            write_atomically(settings_path(out), json.dumps(settings, indent=2) + "\n")
    console().print(f"{count} rows are in {out}.", markup=False)


def _export_episodes(file: Path, out: Path) -> int:
    prepare_jax()
    import importlib

    from deggflow.tables import Episode, is_table, read_info, table_rows, write_lerobot
    from deggflow.tables.lerobot import ACTION, misfit
    from deggflow.tables.parquet import kind_of

    if is_table(file):
        entry = entry_named(str(read_info(file).about.get("task")))
        rows = table_rows(file, kind_of(file, entry.load_lines()))
    else:
        rows = read_rows(file)
        first = next(rows, None)
        entry = entry_named(kind_of_line(first, {}).task)
        rows = chain([first] if first else [], rows)
    if not isinstance(entry, ShippedEntry) or entry.episodes is None:
        raise InputError(f"{entry.noun}s are no episodes: nothing moves in time", file=file)
    module, parse = importlib.import_module(entry.episodes), entry.load_task().parse_result

    def results() -> Iterator[tuple[int, Any]]:
        for number, row in enumerate(rows, start=1):
            try:
                yield number, parse(row)
            except InputError as error:
                raise InputError(error.reason, file=file, line=number, field=error.field) from None

    each = results()
    one = next(each, None)
    if one is None:
        raise InputError("there is no episode to write", file=file)
    form = module.format_of(one[1])

    def episodes() -> Iterator[Episode]:
        for number, result in chain([one], each):
            episode = module.episode(result)
            if reason := misfit(episode, form):
                raise InputError(reason, file=file, line=number)
            if len(episode.features[ACTION]):  # a trial that ended at once has no frame
                yield episode

    count = write_lerobot(out, form, episodes())
    console().print(f"{count} episodes are in {out}.", markup=False)
    return SATISFIED


def read_rows(file: Path) -> Iterator[dict[str, Any]]:
    """The values of a JSON Lines file, one at a time; raises `InputError` naming the line."""
    number = 0
    try:
        with file.open("rb") as content:
            while line := content.readline(MAX_LINE + 2):
                number += 1
                yield parse_line(line.rstrip(b"\r\n"))
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", file=file) from None
    except InputError as error:
        raise InputError(error.reason, file=file, line=number, field=error.field) from None


def write_table(
    out: Path, rows: Iterator[dict[str, Any]], settings: Mapping[str, Any], task: str | None = None
) -> int:
    """Writes a table of results.

    Args:
        out: The table, which appears once it is complete.
        rows: JSON objects.
        settings: Settings of the run that made them.
        task: Name of their task, if the settings don't name it.

    Returns:
        The number of rows.
    """
    from deggflow.files import replacing
    from deggflow.tables import write_rows

    first = next(rows, None)
    if first is None:
        raise InputError("there is no row, and a table's columns depend on the first one", file=out)
    kind = kind_of_line(first, settings, task)
    about = {"task": kind.task, "run": dict(settings)}
    with replacing(out) as temporary:
        return write_rows(temporary, kind.line, chain([first], rows), about)


class LineKind(NamedTuple):
    """What a line of a file is.

    Attributes:
        task: Name of its task.
        line: Its type.
    """

    task: str
    line: type[Any]


def kind_of_line(value: Any, settings: Mapping[str, Any], task: str | None = None) -> LineKind:
    """The kind of a line: of the named task, or the task whose command wrote it, or by its keys.

    Raises:
        InputError: The line is of no kind of the task, or of no shipped task.
    """
    command = str(settings.get("command", "")).split()
    name = task or (command[0] if command else None)
    entries = list(SHIPPED) if name is None else [entry_named(name)]
    keys = set(value) if isinstance(value, dict) else set()
    for entry in entries:
        for line in entry.load_lines():
            if keys and keys == set(get_type_hints(line)):
                return LineKind(entry.name, line)
    of = "a shipped task; name the line's task with --task" if name is None else f"the task {name}"
    raise InputError(f"the first line is no line of {of}: got the keys {quoted(sorted(keys))}")
