"""A line of a file, and how a file that holds a bad one is refused."""

import json

import pytest

from deggflow.jsonl import InputError


def line(value):
    return json.dumps(value, allow_nan=False).encode()


def refusal(read, path):
    """The message of the error that reading a file raises; it is one line of printable text."""
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.isprintable()
    message.encode()
    assert str(path) in message
    return message


def check(read, path, content, number, field, word):
    path.write_bytes(content)
    message = refusal(read, path)
    place, reason = message.removeprefix(str(path)).split(": ", 1)
    assert place == f", line {number}" + (f", field `{field}`" if field else "")
    assert word in reason
    assert len(message) < 600  # a quotation of what was wrong, not all of it
