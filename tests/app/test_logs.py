"""`--log`: what training reports, read back from the stores of TensorBoard and trackio."""

import sys

import pytest

from deggflow.app.logs import PROJECT, logged
from deggflow.jsonl import InputError
from deggflow.train import Curve

CURVES = [Curve(20, 0.5, 0.25), Curve(40, 0.25, 0.125)]


def test_event_files_of_tensorboard(tmp_path):
    pytest.importorskip("tensorboardX")
    from tensorboardX.proto.event_pb2 import Event

    with logged("tensorboard", tmp_path) as on_progress:
        for curve in CURVES:
            on_progress(curve)
    # A record is the event's length (8 bytes), a checksum (4), the event and another checksum (4).
    [file] = (tmp_path / "tensorboard").iterdir()
    content, events = file.read_bytes(), []
    while content:
        end = 12 + int.from_bytes(content[:8], "little")
        events.append(Event.FromString(content[12:end]))
        content = content[end + 4 :]
    stored = [
        (event.step, value.tag, value.simple_value)
        for event in events
        for value in event.summary.value
    ]
    assert stored == [
        (20, "training/loss", 0.5), (20, "validation/loss", 0.25),
        (40, "training/loss", 0.25), (40, "validation/loss", 0.125),
    ]  # fmt: skip


def test_a_run_of_trackio_is_resumed(tmp_path, monkeypatch, capsys):
    pytest.importorskip("trackio")
    from trackio import sqlite_storage

    monkeypatch.setattr(sqlite_storage, "TRACKIO_DIR", tmp_path / "store")
    for curve in CURVES:
        with logged("trackio", tmp_path) as on_progress:
            on_progress(curve)
    rows = sqlite_storage.SQLiteStorage.get_logs(PROJECT, str(tmp_path.resolve()))
    assert [(row["step"], row["training/loss"]) for row in rows] == [(20, 0.5), (40, 0.25)]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("log", ["tensorboard", "trackio"])
def test_what_to_install_is_said(log, tmp_path, monkeypatch):
    for package in ("tensorboardX", "trackio"):
        monkeypatch.setitem(sys.modules, package, None)
    needed = pytest.raises(InputError, match=rf"--log {log} needs .*'deggflow\[{log}\]'")
    with needed, logged(log, tmp_path):
        pass
    with logged("none", tmp_path) as on_progress:
        on_progress(CURVES[0])
    assert not [*tmp_path.iterdir()]
