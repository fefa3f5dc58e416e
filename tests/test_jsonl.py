import json

import pytest

from deggflow.jsonl import (
    MAX_LINE,
    InputError,
    ResumableOutput,
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
        assert caught.value.reason == reason + (value if value == "a" else json.dumps(value))


def test_an_interrupted_file_is_completed(tmp_path):
    path = tmp_path / "out.jsonl"
    with ResumableOutput(str(path), SETTINGS) as lines:
        assert lines.finished == []
        lines.append([{"k": 0}, {"k": 1}])
    with path.open("ab") as file:
        file.write(b'{"k": 2, "hal')  # a kill in the middle of a line
    with ResumableOutput(path, SETTINGS) as lines:
        assert lines.finished == [{"k": 0}, {"k": 1}]
        lines.append([{"k": 2}])
    assert [json.loads(line)["k"] for line in path.read_text().splitlines()] == [0, 1, 2]


def test_another_runs_file_is_left_alone(tmp_path):
    path = tmp_path / "out.jsonl"
    with ResumableOutput(path, SETTINGS) as lines:
        lines.append([{"k": 0}])
    before = path.read_bytes()
    with pytest.raises(InputError, match="begun with seed = 0, not 1"):
        ResumableOutput(path, {**SETTINGS, "seed": 1})
    foreign = tmp_path / "notes.txt"
    foreign.write_text("mine")
    with pytest.raises(InputError, match="was not begun by this command"):
        ResumableOutput(foreign, SETTINGS)
    with pytest.raises(InputError, match="is a folder"):
        ResumableOutput(tmp_path, SETTINGS)
    assert path.read_bytes() == before
    assert foreign.read_text() == "mine"


def test_two_runs_do_not_write_one_file(tmp_path):
    path = tmp_path / "out.jsonl"
    with (
        ResumableOutput(path, SETTINGS),
        pytest.raises(InputError, match="another run"),
        ResumableOutput(path, SETTINGS),
    ):
        pass


def test_numbers_that_are_not_finite_are_never_written(tmp_path):
    with (
        ResumableOutput(tmp_path / "x", SETTINGS) as lines,
        pytest.raises(ValueError, match="JSON"),
    ):
        lines.append([{"a": float("nan")}])
