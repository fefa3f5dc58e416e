"""Strict parsing of JSON values into annotated dataclasses: all fields, of their types, and no others."""

import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from . import jsonl

T = TypeVar("T")

_MOST = 1e300  # far above any measured value
_LARGEST = 2**63 - 1  # of integers


def parse_as(kind: type[T], value: Any, field: str = "") -> T:
    """A dataclass from its JSON object.

    Annotations may be bool, int, float, str, None, Any, dataclasses, unions with None, and sequences, tuples and
    str-keyed mappings of these. A float may be written as an integer; numbers are finite.

    Args:
        kind: A dataclass.
        value: The output of `json.loads`.
        field: Its name, for messages.

    Raises:
        InputError: A field is missing, unknown or of another type; names the field.

    Example:
        >>> from dataclasses import dataclass
        >>> @dataclass
        ... class Row:
        ...     size: int
        ...     rate: float | None
        >>> parse_as(Row, {"size": 8, "rate": 0.5})
        Row(size=8, rate=0.5)
        >>> parse_as(Row, {"size": "8", "rate": None})
        Traceback (most recent call last):
        ...
        deggflow.jsonl.InputError: field `size`: must be an integer; got "8"
    """
    parsed: T = _parse(kind, value, field)
    return parsed


def _parse(kind: Any, value: Any, field: str) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if origin in (Union, types.UnionType):
        (other,) = (part for part in parts if part is not type(None))
        return None if value is None else _parse(other, value, field)
    if is_dataclass(kind):
        return _object(kind, value, field)
    if origin is not None and issubclass(origin, Mapping):
        items = jsonl.expect_object(value, field, tuple(value) if isinstance(value, dict) else ())
        return {key: _parse(parts[1], item, jsonl.join(field, key)) for key, item in items.items()}
    if origin is not None and issubclass(origin, Sequence):
        entries = jsonl.expect_list(value, field)
        fixed_length = origin is tuple and parts[-1] is not Ellipsis
        if fixed_length and len(entries) != len(parts):
            raise jsonl.InputError(
                f"must hold {len(parts)} values; got {len(entries)}", field=field
            )
        kinds = parts if fixed_length else parts[:1] * len(entries)
        values = [
            _parse(each, entry, f"{field}[{k}]")
            for k, (each, entry) in enumerate(zip(kinds, entries, strict=True))
        ]
        return tuple(values) if origin is tuple else values
    return _plain(kind, value, field)


def _object(kind: Any, value: Any, field: str) -> Any:
    names = tuple(each.name for each in fields(kind))
    row = jsonl.expect_object(value, field, names, names)
    hints = get_type_hints(kind)
    return kind(**{name: _parse(hints[name], row[name], jsonl.join(field, name)) for name in names})


def _plain(kind: Any, value: Any, field: str) -> Any:
    if kind is bool:
        return jsonl.expect_flag(value, field)
    if kind is int:
        return jsonl.expect_integer(value, field, -_LARGEST, _LARGEST)
    if kind is float:
        return jsonl.expect_number(value, field, -_MOST, _MOST, "")
    if kind is str:
        return jsonl.expect_text(value, field)
    raise TypeError(f"`kind` has a field of type {kind}, which has no JSON form.")
