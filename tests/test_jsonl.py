import json

import pytest

from deggflow.jsonl import (
    MAX_LINE,
    InputError,
    expect_list,
    expect_text,
    parse_line,
    read_lines,
)

SETTINGS = {"seed": 0, "count": 4}


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b'{"a": 1', "not JSON"),
        (b"", "empty"),
        (b"   ", "empty"),
        (b'{"a": NaN}', "NaN is not a finite number"),
        (b'{"a": -Infinity}', "-Infinity is not a finite number"),
        (b'{"a": 1, "a": 2}', "twice"),
        (b"\xff\xfe{", "not UTF-8"),
        (b"[" * 50_000, "nested too deeply"),
        (b'{"a": ' + b"9" * 6000 + b"}", "too many digits"),
        (b'"' + b"x" * MAX_LINE + b'"', "longer than"),
    ],
)
def test_what_is_not_strict_json_is_refused(line, reason):
    with pytest.raises(InputError, match=reason):
        parse_line(line)


def test_errors_are_one_line_with_file_and_line(tmp_path):
    path = tmp_path / "x.jsonl"
    path.write_text('{"a": 1}\n{"a":\n')
    with pytest.raises(InputError) as caught:
        read_lines(str(path), lambda value: value, "thing")
    assert str(caught.value).startswith(f"{path}, line 2: not JSON")
    assert "\n" not in str(InputError("two\nlines \x07", file="a\nb"))


@pytest.mark.parametrize(
    ("expect", "good", "bad", "reason"),
    [
        (expect_text, ["", "a"], [None, 1, True, ["a"], {}], "must be text; got "),
        (expect_list, [[], ["a", 1]], [None, 1, True, "a", {"a": 1}], "must be a list; got "),
    ],
)
def test_text_and_lists_are_told_from_everything_else(expect, good, bad, reason):
    for value in good:
        assert expect(value, "a.b") is value
    for value in bad:
        with pytest.raises(InputError) as caught:
            expect(value, "a.b")
        assert caught.value.field == "a.b"
        assert caught.value.reason == reason + json.dumps(value)


def test_a_byte_order_mark_before_the_first_line_is_no_part_of_it(tmp_path):
    """Editors write one; anywhere else it is an error."""
    path = tmp_path / "marked.jsonl"
    path.write_bytes(b"\xef\xbb\xbf[1]\n[2]\n")
    assert read_lines(path, list, "list") == [[1], [2]]
    path.write_bytes(b"[1]\n\xef\xbb\xbf[2]\n")
    with pytest.raises(InputError, match="line 2: not JSON"):
        read_lines(path, list, "list")
