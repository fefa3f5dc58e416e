import os
import stat
import subprocess
import sys

import pytest

from deggflow.files import write_atomically


def test_replaces_content_and_makes_folders(tmp_path):
    path = tmp_path / "a" / "b.txt"
    write_atomically(str(path), "one")
    write_atomically(path, b"two")
    assert path.read_bytes() == b"two"
    assert [p.name for p in path.parent.iterdir()] == ["b.txt"]


def test_mode_follows_umask(tmp_path):
    before = os.umask(0o022)
    try:
        write_atomically(tmp_path / "x", "")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "x").stat().st_mode) == 0o644


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "x"
    write_atomically(path, "old")

    def broken(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


FULL = """
import resource, sys
from deggflow.files import write_atomically

resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))  # as a full disk: the write fails, not the opening
try:
    write_atomically(sys.argv[1], "x" * 100)
except OSError as error:
    print(error.filename)
"""


def test_a_write_that_fails_names_its_file_and_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    found = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == str(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
