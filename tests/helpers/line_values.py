"""Values of the types of lines."""

from collections.abc import Mapping
from typing import Literal, NotRequired, get_args, get_origin, get_type_hints, is_typeddict


def value_of(kind, *, full, depth=0):
    """A value of a type: with all keys that may be absent, or with none."""
    origin, parts = get_origin(kind), get_args(kind)
    if is_typeddict(kind) or hasattr(kind, "__dataclass_fields__"):
        hints = get_type_hints(kind, include_extras=True)
        optional = getattr(kind, "__optional_keys__", ())
        names = [name for name in hints if full or name not in optional]
        bare = {n: get_args(h)[0] if get_origin(h) is NotRequired else h for n, h in hints.items()}
        return {name: value_of(bare[name], full=full, depth=depth + 1) for name in names}
    if origin is Literal:
        return parts[0]
    if type(None) in parts:
        return value_of(parts[0], full=full, depth=depth) if full else None
    if origin is not None and issubclass(origin, Mapping):
        names = ("b", "a") if full else ()
        return {name: value_of(parts[1], full=full, depth=depth + 1) for name in names}
    if origin is not None:
        return [value_of(parts[0], full=full, depth=depth + 1) for _ in range(2 * full)]
    return {bool: True, int: 7 + depth, float: 0.1 + depth, str: "naïve\n"}[kind]
