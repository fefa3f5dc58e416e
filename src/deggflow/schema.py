"""JSON values as the annotated dataclasses they stand for: every field there, of its type, and no other."""

import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from . import jsonl

T = TypeVar("T")

_MOST = 1e300  # far above whatever is measured
_LARGEST = 2**63 - 1  # of whole numbers


def parse_as(kind: type[T], value: Any, field: str = "") -> T:
    """A dataclass from its JSON object.

    Annotations may be bool, int, float, str, None, Any, dataclasses, unions with None, and sequences, tuples and
    mappings from text of them. A float may be written as an integer; numbers are finite.

    Args:
        kind: A dataclass.
        value: What `json.loads` gave.
        field: Where it stands, for messages.

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
    found: T = _parsed(kind, value, field)
    return found


def _parsed(kind: Any, value: Any, field: str) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if origin in (Union, types.UnionType):
        (other,) = (part for part in parts if part is not type(None))
        return None if value is None else _parsed(other, value, field)
    if is_dataclass(kind):
        return _object(kind, value, field)
    if origin is not None and issubclass(origin, Mapping):
        given = jsonl.expect_object(value, field, tuple(value) if isinstance(value, dict) else ())
        return {key: _parsed(parts[1], item, jsonl.join(field, key)) for key, item in given.items()}
    if origin is not None and issubclass(origin, Sequence):
        items = jsonl.expect_list(value, field)
        if origin is tuple and parts[-1] is not Ellipsis and len(items) != len(parts):
            raise jsonl.InputError(f"must hold {len(parts)} values; got {len(items)}", field=field)
        kinds = parts if origin is tuple and parts[-1] is not Ellipsis else parts[:1] * len(items)
        made = [
            _parsed(each, item, f"{field}[{k}]")
            for k, (each, item) in enumerate(zip(kinds, items, strict=True))
        ]
        return tuple(made) if origin is tuple else made
    return _plain(kind, value, field)


def _object(kind: Any, value: Any, field: str) -> Any:
    names = tuple(each.name for each in fields(kind))
    given = jsonl.expect_object(value, field, names, names)
    hints = get_type_hints(kind)
    return kind(
        **{name: _parsed(hints[name], given[name], jsonl.join(field, name)) for name in names}
    )


def _plain(kind: Any, value: Any, field: str) -> Any:
    if kind is bool:
        return jsonl.expect_flag(value, field)
    if kind is int:
        return jsonl.expect_integer(value, field, -_LARGEST, _LARGEST)
    if kind is float:
        return jsonl.expect_number(value, field, -_MOST, _MOST, "")
    if kind is str:
        return jsonl.expect_text(value, field)
    raise TypeError(f"`kind` has a field of type {kind}, which no JSON value stands for.")
