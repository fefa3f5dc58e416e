"""Strict reading of JSON and JSON Lines; errors name the file, the line and the field."""

import json
import math
import os
from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Mapping, Sequence
from io import BufferedIOBase
from pathlib import Path
from typing import Any, TypeVar

from .files import StrPath

T = TypeVar("T")
Choice = TypeVar("Choice", bound=str)

MAX_LINE = 4 << 20  # bytes; a large scene of 10,000 objects takes half of that
MAX_LINES = 1_000_000
MAX_FILE = 64 << 20  # bytes of a file that holds one object


class InputError(Exception):
    """Bad input, with file, line, field and reason. Commands print it in one line and exit with 2."""

    def __init__(
        self,
        reason: str,
        *,
        file: StrPath | None = None,
        line: int | None = None,
        field: str = "",
    ) -> None:
        self.reason, self.file, self.line, self.field = reason, file, line, field
        super().__init__(reason)

    def __str__(self) -> str:
        place = [] if self.file is None else [os.fspath(self.file)]
        place += [] if self.line is None else [f"line {self.line}"]
        place += [f"field `{self.field}`"] if self.field else []
        text = f"{', '.join(place)}: {self.reason}" if place else self.reason
        return " ".join("".join(c if c.isprintable() else repr(c)[1:-1] for c in text).split())


def _refuse_constant(name: str) -> None:
    raise InputError(f"{name} is not a finite number")


def _refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in pairs:
        if key in out:
            raise InputError("this key is listed twice", field=shorten(key))
        out[key] = value
    return out


def shorten(value: Any, limit: int = 60) -> str:
    """A value as text for a message, at most `limit` characters long."""
    try:
        text = value if isinstance(value, str) else json.dumps(value, default=str)
    except RecursionError:
        text = "a deeply nested value"
    return text if len(text) <= limit else text[: limit - 3] + "..."


def quoted(value: Any) -> str:
    """A value as JSON text for a message, strings in quotation marks."""
    return shorten(json.dumps(value) if isinstance(value, str) else value)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise InputError(f"{shorten(text)} is not a finite number")
    return number


def _parse(text: bytes, parse_float: Callable[[str], float] | None) -> Any:
    try:
        return json.loads(
            text.decode("utf-8"),
            object_pairs_hook=_refuse_duplicates,
            parse_constant=_refuse_constant,
            parse_float=parse_float,
        )
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text (byte {error.start + 1})") from None
    except json.JSONDecodeError as error:
        where = f"column {error.colno}"
        if error.lineno > 1:
            where = f"line {error.lineno}, {where}"
        raise InputError(f"not JSON: {error.msg} ({where})") from None
    except RecursionError:
        raise InputError("not valid JSON: nested too deeply") from None
    except ValueError:  # an integer with more digits than Python converts
        raise InputError("a number has too many digits") from None


def parse_line(text: bytes) -> Any:
    """Parses one line as JSON: UTF-8, no NaN, no duplicate keys. Raises `InputError` without file and line.

    A number that overflows passes; the check of its field reports it with the field's name.
    """
    if len(text) > MAX_LINE:
        raise InputError(f"the line is longer than {MAX_LINE} bytes")
    if not text.strip():
        raise InputError("the line is empty")
    return _parse(text, None)


def read_json(path: StrPath) -> dict[str, Any]:
    """Reads a JSON object from a file: UTF-8, finite numbers, no duplicate keys.

    Raises:
        FileNotFoundError: There is no such file; the caller decides what that means.
        InputError: The file can't be read, or does not hold a JSON object; names the file.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE:
            raise InputError(f"the file is larger than {MAX_FILE} bytes")
        value = _parse(path.read_bytes().removeprefix(BOM_UTF8), _finite)
        return dict(expect_object(value, "", tuple(value) if isinstance(value, dict) else ()))
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", file=path) from None
    except InputError as error:
        raise InputError(error.reason, file=path, field=error.field) from None


def read_lines(path: StrPath, parse: Callable[[Any], T], what: str) -> list[T]:
    """Reads a file and applies `parse` to the value of every line.

    Raises:
        InputError: A line is invalid; names file, line, field and reason of the first error.
    """
    try:
        with Path(path).open("rb") as file:
            return parse_lines(file, path, parse, what)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", file=path) from None


def parse_lines(
    file: BufferedIOBase, name: StrPath, parse: Callable[[Any], T], what: str
) -> list[T]:
    """As `read_lines`, for an open file or text in memory.

    Args:
        file: Yields the lines.
        name: Of the file, for messages.
        parse: Applied to the value of every line.
        what: One line holds, for messages.

    Raises:
        InputError: A line is invalid; names file, line, field and reason of the first error.
    """
    out: list[T] = []
    try:
        while line := file.readline(MAX_LINE + 2):
            if len(out) == MAX_LINES:
                raise InputError(f"more than {MAX_LINES} lines")
            text = line.rstrip(b"\r\n")
            out.append(parse(parse_line(text if out else text.removeprefix(BOM_UTF8))))
    except InputError as error:
        raise InputError(error.reason, file=name, line=len(out) + 1, field=error.field) from None
    if not out:
        raise InputError(f"the file is empty; it must hold one {what} a line", file=name, line=1)
    return out


def expect_object(
    value: Any, field: str, allowed: Sequence[str], required: Sequence[str] = ()
) -> Mapping[str, Any]:
    """Checks that a value is an object with no unknown and no missing keys."""
    if not isinstance(value, dict):
        raise InputError(f"must be a JSON object; got {quoted(value)}", field=field)
    for key in value:
        if key not in allowed:
            raise InputError(
                f"unknown key; known are {', '.join(allowed)}", field=join(field, shorten(key))
            )
    for key in required:
        if key not in value:
            raise InputError("is missing", field=join(field, key))
    return value


def expect_number(value: Any, field: str, low: float, high: float, unit: str) -> float:
    """Checks that a value is a finite number in [low, high]."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"must be a number; got {quoted(value)}", field=field)
    # Compared before the conversion: a huge integer has no float.
    if not low <= value <= high or not math.isfinite(value):
        raise InputError(
            f"must lie in [{low:g}, {high:g}]{unit and ' '}{unit}; got {quoted(value)}",
            field=field,
        )
    return float(value)


def expect_integer(value: Any, field: str, low: int, high: int) -> int:
    """Checks that a value is an integer in [low, high]."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f"must be an integer; got {quoted(value)}", field=field)
    if not low <= value <= high:
        raise InputError(f"must lie in [{low}, {high}]; got {quoted(value)}", field=field)
    return value


def expect_flag(value: Any, field: str) -> bool:
    """Checks that a value is true or false."""
    if not isinstance(value, bool):
        raise InputError(f"must be true or false; got {quoted(value)}", field=field)
    return value


def expect_text(value: Any, field: str) -> str:
    """Checks that a value is text."""
    if not isinstance(value, str):
        raise InputError(f"must be text; got {quoted(value)}", field=field)
    return value


def expect_choice(value: Any, field: str, choices: Collection[Choice]) -> Choice:
    """Checks that a value is one of some texts."""
    for choice in choices:
        if value == choice:
            return choice
    raise InputError(f"must be one of {', '.join(choices)}; got {quoted(value)}", field=field)


def expect_list(value: Any, field: str) -> list[Any]:
    """Checks that a value is a list."""
    if not isinstance(value, list):
        raise InputError(f"must be a list; got {quoted(value)}", field=field)
    return value


def expect_reason(value: Any, field: str) -> str | None:
    """Checks that a value is text or null."""
    if not isinstance(value, str | None):
        raise InputError(f"must be text or null; got {quoted(value)}", field=field)
    return value


def join(field: str, key: str) -> str:
    """The name of a nested field."""
    return f"{field}.{key}" if field else key
