"""Files that runs append to: completed after a kill, never mixed, never silently lost."""

import json
import os
import shutil
import threading

import pytest

from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget

SETTINGS = {"command": "test", "seed": 0}


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
    with pytest.raises(InputError, match="names a table"):
        ResumableOutput(tmp_path / "x.parquet", SETTINGS)
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


DAMAGE = {
    "NUL bytes": b"\0\0\0\n",
    "broken JSON": b'{"k": \n',
    "an empty object": b"{}\n",
    "a list": b"[1]\n",
    "text that is not UTF-8": b'{"k": "\xff"}\n',
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_complete_lines_are_named_and_left_alone(tmp_path, kind):
    path = tmp_path / "out.jsonl"
    with ResumableOutput(path, SETTINGS) as lines:
        lines.append([{"k": 0}])
    with path.open("ab") as file:
        file.write(DAMAGE[kind] + b'{"k": 2}\n')
    before = path.read_bytes()
    with pytest.raises(InputError, match="was damaged after it was written") as caught:
        ResumableOutput(path, SETTINGS).__enter__()
    assert caught.value.line == 2
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", ["[1]", "7", "null", "[" * 100_000, "", "{"])
def test_settings_that_are_none_are_no_run(tmp_path, content):
    path = tmp_path / "out.jsonl"
    with ResumableOutput(path, SETTINGS) as lines:
        lines.append([{"k": 0}])
    (tmp_path / "out.jsonl.run.json").write_text(content)
    with pytest.raises(InputError, match="was not begun by this command"):
        ResumableOutput(path, SETTINGS)


def test_a_file_that_is_longer_or_begins_elsewhere_is_another_runs(tmp_path):
    path = tmp_path / "out.jsonl"
    options = {"count": 3, "belongs": lambda number, row: row["k"] == number}
    with ResumableOutput(path, SETTINGS, **options) as lines:
        lines.append([{"k": 0}, {"k": 1}, {"k": 2}])
    whole = path.read_bytes().splitlines(keepends=True)
    for content, reason in (
        (whole[1:], "is not line 1 of this run"),
        ([whole[0], whole[2]], "is not line 2 of this run"),
        ([*whole, whole[2]], "has more lines than the 3 of this run"),
    ):
        path.write_bytes(b"".join(content))
        with pytest.raises(InputError, match=reason):
            ResumableOutput(path, SETTINGS, **options).__enter__()
        assert path.read_bytes() == b"".join(content)


@pytest.mark.parametrize("more", [[{"k": 1}], []], ids=["before a row", "after the last row"])
def test_a_file_that_is_removed_or_replaced_while_it_is_written_is_missed(more, tmp_path):
    folder = tmp_path / "gone"
    path = folder / "out.jsonl"

    def replace():
        (folder / "other").write_bytes(b"")
        os.replace(folder / "other", path)

    def write(disturb):
        with ResumableOutput(path, SETTINGS) as lines:
            lines.append([{"k": 0}])
            disturb()
            if more:
                lines.append(more)

    with pytest.raises(InputError, match="was removed while"):
        write(lambda: shutil.rmtree(folder))
    with pytest.raises(InputError, match="was replaced while"):
        write(replace)


def test_a_full_disk_is_one_line():
    with (
        ResumableOutput("/dev/full", SETTINGS) as lines,
        pytest.raises(InputError, match="No space left on device; finished lines are kept"),
    ):
        lines.append([{"k": 0}])


def test_special_files_and_empty_ones_are_written_to(tmp_path):
    with ResumableOutput("/dev/null", SETTINGS) as lines:
        lines.append([{"k": 0}])
    empty = tmp_path / "empty.jsonl"
    empty.touch()
    with ResumableOutput(empty, SETTINGS) as lines:
        lines.append([{"k": 0}])
    assert empty.read_text() == '{"k": 0}\n'


def test_rows_are_told_of_and_not_kept(tmp_path):
    path, seen = tmp_path / "out.jsonl", []
    with ResumableOutput(path, SETTINGS, on_row=forget) as lines:
        lines.append([{"k": k} for k in range(5)])
        assert lines.done == 5
    with ResumableOutput(path, SETTINGS, on_row=seen.append) as lines:
        assert (lines.done, lines.finished) == (5, [])
    assert seen == [{"k": k} for k in range(5)]


def test_settings_are_checked_while_nobody_else_can_change_them(tmp_path):
    """Two runs that begin at once: one writes, the other is refused, whichever comes first."""
    path, refused = tmp_path / "out.jsonl", []
    gate = threading.Barrier(2)

    def run(seed):
        try:
            output = ResumableOutput(path, {"seed": seed})
            gate.wait()
            with output as lines:
                lines.append([{"seed": seed}])
        except InputError as error:
            refused.append(str(error))

    threads = [threading.Thread(target=run, args=(seed,)) for seed in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(refused) == 1
    assert len(path.read_text().splitlines()) == 1
