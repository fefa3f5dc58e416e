"""Columns of a table from the type of a line: TypedDicts and dataclasses become structs, mappings lists of named entries."""

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from typing import (
    Any,
    Literal,
    NamedTuple,
    NotRequired,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

from deggflow import jsonl
from deggflow.extras import imported
from deggflow.jsonl import InputError

_MOST, _LARGEST = 1e300, 2**63 - 1
NAME = "name"  # of an entry of a mapping


class Column(NamedTuple):
    """How values of one type are held in a table.

    Attributes:
        type: Type of pyarrow.
        encode: The table's value from a JSON value; raises `InputError` naming the field if it is not of the type.
        decode: The JSON value from the table's.
    """

    type: Any
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]


def column(kind: Any) -> Column:
    """The column of a type.

    Types may be bool, int, float, str, Literal, TypedDicts, dataclasses, unions with None, sequences and str-keyed
    mappings of these, and the union of a TypedDict and the name of one. An absent key of a TypedDict is null in the table.

    Example:
        >>> from typing import NotRequired, TypedDict
        >>> class Robot(TypedDict):
        ...     radius: float
        ...     speed: NotRequired[float]
        >>> robots = column(Mapping[str, Robot])
        >>> str(robots.type)
        'list<item: struct<name: string, radius: double, speed: double>>'
        >>> robots.encode({"a": {"radius": 1}})
        [{'name': 'a', 'radius': 1.0, 'speed': None}]
        >>> robots.decode(robots.encode({"a": {"radius": 1}}))
        {'a': {'radius': 1.0}}
        >>> robots.encode({"a": {"radius": "1"}})
        Traceback (most recent call last):
        ...
        deggflow.jsonl.InputError: field `a.radius`: must be a number; got "1"
    """
    return _column(kind)


@cache
def _column(kind: Any) -> Column:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        others = [part for part in parts if part is not type(None)]
        if len(others) == 2 and str in others:
            (whole,) = (part for part in others if part is not str)
            return _named(column(whole))
        (other,) = others
        return _optional(column(other))
    if is_typeddict(kind) or is_dataclass(kind):
        return _struct(kind)
    if origin is Literal:
        return column(str)
    if origin is not None and issubclass(origin, Mapping):
        return _mapping(column(parts[1]))
    if origin is not None and issubclass(origin, Sequence):
        if len({part for part in parts if part is not Ellipsis}) > 1:
            raise TypeError(f"`kind` has entries of several types: {kind}.")
        return _sequence(column(parts[0]))
    return _plain(kind)


def _plain(kind: Any) -> Column:
    arrow = imported("pyarrow", "data", "a Parquet table")
    checks: dict[Any, tuple[Any, Callable[[Any], Any]]] = {
        bool: (arrow.bool_(), lambda value: jsonl.expect_flag(value, "")),
        int: (arrow.int64(), lambda value: jsonl.expect_integer(value, "", -_LARGEST, _LARGEST)),
        float: (arrow.float64(), lambda value: jsonl.expect_number(value, "", -_MOST, _MOST, "")),
        str: (arrow.string(), lambda value: jsonl.expect_text(value, "")),
    }
    if kind not in checks:
        raise TypeError(f"`kind` has a part of type {kind}, which has no column.")
    type_, encode = checks[kind]
    return Column(type_, encode, lambda value: value)


def _optional(inner: Column) -> Column:
    def apply(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda value: None if value is None else convert(value)

    return Column(inner.type, apply(inner.encode), apply(inner.decode))


def _within(name: str, convert: Callable[[Any], Any], value: Any) -> Any:
    """A part's value; errors name the part."""
    try:
        return convert(value)
    except InputError as error:
        inner = error.field
        field = f"{name}{inner}" if inner.startswith("[") else jsonl.join(name, inner)
        raise InputError(error.reason, field=field if inner else name) from None


def _sequence(inner: Column) -> Column:
    arrow = imported("pyarrow", "data", "a Parquet table")

    def encode(value: Any) -> list[Any]:
        entries = jsonl.expect_list(value, "")
        return [_within(f"[{k}]", inner.encode, entry) for k, entry in enumerate(entries)]

    return Column(arrow.list_(inner.type), encode, lambda value: [inner.decode(v) for v in value])


def parts_of(kind: Any) -> dict[str, Column]:
    """The columns of a TypedDict's keys, or of a dataclass's fields."""
    hints = get_type_hints(kind, include_extras=True)
    bare = {n: get_args(h)[0] if get_origin(h) is NotRequired else h for n, h in hints.items()}
    return {name: column(bare[name]) for name in bare}


def _optional_keys(kind: Any) -> set[str]:
    hints = get_type_hints(kind, include_extras=True)
    marked = {name for name, hint in hints.items() if get_origin(hint) is NotRequired}
    return marked | set(getattr(kind, "__optional_keys__", ()))


def _struct(kind: Any) -> Column:
    arrow = imported("pyarrow", "data", "a Parquet table")
    inner, optional = parts_of(kind), _optional_keys(kind)
    required = [name for name in inner if name not in optional]

    def encode(value: Any) -> dict[str, Any]:
        jsonl.expect_object(value, "", tuple(inner), required)
        return {
            name: _within(name, each.encode, value[name]) if name in value else None
            for name, each in inner.items()
        }

    def decode(value: Any) -> dict[str, Any]:
        return {
            name: each.decode(value[name])
            for name, each in inner.items()
            if name not in optional or value[name] is not None
        }

    struct = arrow.struct([arrow.field(name, each.type) for name, each in inner.items()])
    return Column(struct, encode, decode)


def _named(inner: Column) -> Column:
    """The column of a struct, or of the name that stands for one."""
    arrow = imported("pyarrow", "data", "a Parquet table")

    def encode(value: Any) -> dict[str, Any]:
        return {NAME: value} if isinstance(value, str) else {NAME: None, **inner.encode(value)}

    def decode(value: Any) -> Any:
        return inner.decode(value) if value[NAME] is None else value[NAME]

    struct = arrow.struct([arrow.field(NAME, arrow.string()), *inner.type])
    return Column(struct, encode, decode)


def _mapping(inner: Column) -> Column:
    arrow = imported("pyarrow", "data", "a Parquet table")
    flat = arrow.types.is_struct(inner.type)
    parts = list(inner.type) if flat else [arrow.field("value", inner.type)]

    def encode(value: Any) -> list[dict[str, Any]]:
        keys = tuple(value) if isinstance(value, dict) else ()
        items = jsonl.expect_object(value, "", keys).items()
        entries = [(key, _within(key, inner.encode, item)) for key, item in items]
        return [{NAME: key, **(item if flat else {"value": item})} for key, item in entries]

    def decode(value: Any) -> dict[str, Any]:
        return {each[NAME]: inner.decode(each if flat else each["value"]) for each in value}

    return Column(
        arrow.list_(arrow.struct([arrow.field(NAME, arrow.string()), *parts])), encode, decode
    )
