"""Parquet files of results: written in groups of rows, read in batches, with what the results were made with."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from deggflow import __version__
from deggflow.extras import imported
from deggflow.files import StrPath
from deggflow.jsonl import MAX_LINES, InputError, expect_object, parse_line, read_lines

from .columns import Column, column, parts_of

T = TypeVar("T")

KEY = b"deggflow"  # of the metadata
NUMBER = "row"  # column: number of the row in its run, from 0
_BATCH = 2048  # rows that are converted at once
_GROUP = 64 << 20  # bytes in memory, from which rows are written as a group
SUFFIX = ".parquet"


class TableInfo(NamedTuple):
    """What a table's metadata say.

    Attributes:
        rows: Number of rows.
        about: JSON values: the task, the settings of the run with its seed, version and digest of the weights.
    """

    rows: int
    about: Mapping[str, Any]


def is_table(path: StrPath) -> bool:
    """Whether a file's name is that of a Parquet table."""
    return Path(path).suffix == SUFFIX


def write_rows(
    path: StrPath,
    kind: type[Any],
    rows: Iterable[Mapping[str, Any]],
    about: Mapping[str, Any],
    *,
    first: int = 0,
) -> int:
    """Writes rows as they come; needs memory for one group of rows.

    Args:
        path: The file, which is replaced; write to a temporary one.
        kind: Type of a row, a TypedDict.
        rows: JSON objects.
        about: JSON values for the metadata.
        first: Number of the first row in its run.

    Raises:
        InputError: A row is not of the type (names row and field); or pyarrow is missing.

    Returns:
        The number of rows.
    """
    arrow = imported("pyarrow", "data", "a Parquet table")
    parquet = imported("pyarrow.parquet", "data", "a Parquet table")
    line = column(kind)
    schema = arrow.schema([arrow.field(NUMBER, arrow.int64(), nullable=False), *line.type])
    count, group, size = 0, list[Any](), 0
    source = iter(rows)
    with parquet.ParquetWriter(
        path, schema, compression="zstd", write_page_checksum=True
    ) as writer:
        while some := list(islice(source, _BATCH)):
            encoded = list(_encoded(line, some, first + count))
            group.append(arrow.RecordBatch.from_pylist(encoded, schema))
            count, size = count + len(some), size + group[-1].nbytes
            if size >= _GROUP:
                writer.write_table(arrow.Table.from_batches(group))
                group, size = [], 0
        writer.write_table(arrow.Table.from_batches(group, schema))
        text = json.dumps({"deggflow": __version__, "rows": count, **about})
        writer.add_key_value_metadata({KEY: text.encode()})
    return count


def _encoded(
    line: Column, rows: Sequence[Mapping[str, Any]], first: int
) -> Iterator[dict[str, Any]]:
    for number, row in enumerate(rows, start=first):
        try:
            yield {NUMBER: number, **line.encode(row)}
        except InputError as error:
            raise InputError(error.reason, line=number + 1, field=error.field) from None


def _open(path: StrPath) -> Any:
    parquet = imported("pyarrow.parquet", "data", "a Parquet table")
    arrow = imported("pyarrow", "data", "a Parquet table")
    try:
        # Read ahead, the bytes of all groups would stay in memory until the file is closed.
        return parquet.ParquetFile(path, page_checksum_verification=True, pre_buffer=False)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", file=path) from None
    except arrow.ArrowException as error:
        raise InputError(f"is no Parquet file: {error}", file=path) from None


def read_info(path: StrPath) -> TableInfo:
    """The number of rows of a table and its metadata. Raises `InputError` if it can't be read."""
    with _open(path) as file:
        text = (file.metadata.metadata or {}).get(KEY, b"{}")
        try:
            value = parse_line(text)
            about = expect_object(value, "", tuple(value) if isinstance(value, dict) else ())
        except InputError as error:
            raise InputError(f"its metadata are damaged: {error.reason}", file=path) from None
        return TableInfo(file.metadata.num_rows, about)


def table_rows(
    path: StrPath, kind: type[Any], names: Sequence[str] | None = None
) -> Iterator[dict[str, Any]]:
    """The rows of a table as JSON objects, in order; needs memory for one group of rows.

    Args:
        path: The file.
        kind: Type of a row, a TypedDict.
        names: Only these columns; None: all.

    Raises:
        InputError: The file can't be read, or has other columns; names the column.
    """
    arrow = imported("pyarrow", "data", "a Parquet table")
    parts = parts_of(kind)
    wanted = list(parts) if names is None else list(names)
    decode = None if names is None else {name: parts[name].decode for name in names}
    line = column(kind)
    with _open(path) as file:
        schema = file.schema_arrow
        for name in wanted:
            if name not in schema.names or not _same(schema.field(name).type, parts[name].type):
                raise InputError("the table has no such column", file=path, field=name)
        try:
            for row in _rows(file, wanted):
                if decode is None:
                    yield line.decode(row)
                else:
                    yield {name: convert(row[name]) for name, convert in decode.items()}
        except (arrow.ArrowException, OSError) as error:
            raise InputError(f"is damaged: {error}", file=path) from None


def _rows(file: Any, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    # One iterator over all groups keeps something of each.
    for group in range(file.num_row_groups):
        for batch in file.iter_batches(_BATCH, row_groups=[group], columns=columns):
            yield from batch.to_pylist()


def _same(one: Any, other: Any) -> bool:
    """Whether two types hold the same values; names of lists' items and large types do not matter."""
    types = imported("pyarrow.types", "data", "a Parquet table")
    listed = (types.is_list, types.is_large_list, types.is_fixed_size_list)
    if any(test(one) for test in listed) and any(test(other) for test in listed):
        return _same(one.value_type, other.value_type)
    if types.is_struct(one) and types.is_struct(other):
        names = {each.name: each.type for each in one}
        return len(names) == other.num_fields and all(
            each.name in names and _same(names[each.name], each.type) for each in other
        )
    if types.is_large_string(one):
        return bool(types.is_string(other))
    return bool(one == other)


def read_results(
    path: StrPath, parse: Callable[[Any], T], what: str, kinds: Sequence[type[Any]]
) -> list[T]:
    """As `jsonl.read_lines`, for JSON Lines and for tables, by the suffix. Args: kinds: possible types of a row."""
    if not is_table(path):
        return read_lines(path, parse, what)
    out: list[T] = []
    try:
        for row in table_rows(path, kind_of(path, kinds)):
            if len(out) == MAX_LINES:
                raise InputError(f"more than {MAX_LINES} rows")
            out.append(parse(row))
    except InputError as error:
        line = len(out) + 1 if error.file is None else error.line
        raise InputError(error.reason, file=path, line=line, field=error.field) from None
    if not out:
        raise InputError(f"the table is empty; it must hold one {what} a row", file=path)
    return out


def kind_of(path: StrPath, kinds: Sequence[type[Any]]) -> type[Any]:
    """The type, of several, whose columns a table has. Raises `InputError` if it is none of them."""
    with _open(path) as file:
        names = set(file.schema_arrow.names) - {NUMBER}
    for kind in kinds:
        if {each.name for each in column(kind).type} == names:
            return kind
    known = " or ".join(f"({', '.join(each.name for each in column(kind).type)})" for kind in kinds)
    raise InputError(
        f"its columns are not {known or 'those of a task'}; got {', '.join(sorted(names))}",
        file=path,
    )


def longest_list(path: StrPath, name: str) -> int:
    """The most entries of a column of lists, such as "condition.objects"; 0 for an empty table."""
    compute = imported("pyarrow.compute", "data", "a Parquet table")
    arrow = imported("pyarrow", "data", "a Parquet table")
    most = 0
    with _open(path) as file:
        try:
            for batch in file.iter_batches(1 << 16, columns=[name]):
                column = batch.column(0)
                for part in name.split(".")[1:]:
                    column = compute.struct_field(column, part)
                most = max(most, compute.max(compute.list_value_length(column)).as_py() or 0)
        except (arrow.ArrowException, OSError) as error:
            raise InputError(f"is damaged: {error}", file=path) from None
        except IndexError:
            raise InputError("the table has no such column", file=path, field=name) from None
    return most
