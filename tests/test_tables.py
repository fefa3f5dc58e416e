"""Parquet tables: every kind of line comes back as it was, and nothing is dropped or changed on the way."""

import doctest
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, get_type_hints

import numpy as np
import pytest
from line_values import value_of

from deggflow import certificate, lines
from deggflow.jsonl import InputError
from deggflow.task.team_sample import TeamCondition, sample_lines
from deggflow.tasks.bridge import lines as bridge
from deggflow.tasks.bridge.trial import PolicyRecord, TrialCertificate
from deggflow.tasks.tabletop.lines import LINES as SCENES

arrow = pytest.importorskip("pyarrow")

from deggflow.tables import (  # noqa: E402
    Episode,
    EpisodeFormat,
    columns,
    read_info,
    read_results,
    table_rows,
    write_lerobot,
    write_rows,
)


@dataclass(frozen=True)
class Drones(TeamCondition):
    goals: tuple[tuple[float, float], ...]
    heights: Mapping[str, float]
    leader: int | None


KINDS = [*SCENES, *bridge.LINES, *sample_lines(Drones)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_kind_of_line_comes_back_as_it_was(kind, tmp_path):
    rows = [value_of(kind, full=full) for full in (True, False, True)]
    about = {"task": "a task", "run": {"seed": 3}}
    path = tmp_path / "lines.parquet"
    assert write_rows(path, kind, iter(rows), about, first=5) == 3
    again = list(table_rows(path, kind))
    assert [json.dumps(row) for row in again] == [json.dumps(row) for row in rows]
    assert read_info(path).rows == 3
    assert read_info(path).about.items() >= about.items()
    assert [row["row"] for row in arrow.parquet.read_table(path, columns=["row"]).to_pylist()] == [
        5,
        6,
        7,
    ]
    some = table_rows(path, kind, ["seed"])
    assert [row["seed"] for row in some] == [row["seed"] for row in rows]


@pytest.mark.parametrize(
    ("line", "record"),
    [
        (lines.RequirementLine, certificate.RequirementRecord),
        (lines.TraceLine, certificate.TraceRecord),
        (lines.LostLine, certificate.LostAgent),
        (lines.GenerationLine, certificate.GenerationRecord),
        (lines.VerdictLine, certificate.RequirementVerdict),
        (lines.CertificateLine, certificate.Certificate),
        (bridge.PolicyLine, PolicyRecord),
        (bridge.TrialCertificateLine, TrialCertificate),
    ],
)
def test_types_of_lines_have_the_fields_of_what_is_written(line, record):
    assert list(get_type_hints(line)) == [field.name for field in fields(record)]


def test_the_example_of_columns_runs():
    assert doctest.testmod(columns).failed == 0


def changed(path, value):
    """A scene's line with one value changed, by the path of its keys."""
    row: Any = value_of(SCENES[0], full=True)
    *parents, last = path
    inner = row
    for key in parents:
        inner = inner[key]
    inner[last] = value
    return row


@pytest.mark.parametrize(
    ("row", "field"),
    [
        (changed(["extra"], 1), "extra"),
        (changed(["certificate", "extra"], 1), "certificate.extra"),
        (changed(["objects", 1, "x"], "1"), "objects[1].x"),
        (changed(["objects", 1, "x"], float("nan")), "objects[1].x"),
        (changed(["condition", "requirements", "a", "direction"], None), "requirements.a.direction"),
        (changed(["condition", "objects", 0], 5), "condition.objects[0]"),
        (changed(["certificate", "generation", "trace", "value", 0, 1], []), "trace.value[0][1]"),
        (changed(["seed"], 1.5), "seed"),
        (changed(["certificate"], []), "certificate"),
    ],
)  # fmt: skip
def test_what_a_column_can_not_hold_is_refused_by_line_and_field(row, field, tmp_path):
    rows = iter([value_of(SCENES[0], full=True), row])
    with pytest.raises(InputError) as caught:
        write_rows(tmp_path / "x.parquet", SCENES[0], rows, {})
    assert caught.value.line == 2
    assert caught.value.field.endswith(field)


def test_files_that_are_no_table_of_the_kind_are_refused(tmp_path):
    path = tmp_path / "x.parquet"
    write_rows(path, bridge.TrialLine, [value_of(bridge.TrialLine, full=True)], {})
    with pytest.raises(InputError, match=r"its columns are not \(condition, objects, cert.*; got"):
        read_results(path, dict, "scene", SCENES)
    with pytest.raises(InputError, match="field `approach`: the table has no such column"):
        list(table_rows(path, bridge.DemonstrationLine))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="is no Parquet file"):
        read_info(path)
    place = (
        content.index(b"\xb5\x2f\xfd", 200) + 20
    )  # within a compressed page of another column than `row`
    path.write_bytes(content[:place] + b"x" + content[place + 1 :])
    with pytest.raises(InputError, match="is damaged"):
        list(table_rows(path, bridge.TrialLine))
    with pytest.raises(InputError, match="can't be read"):
        read_info(tmp_path / "none.parquet")


def test_a_row_that_is_no_result_is_named_by_file_and_line(tmp_path):
    path = tmp_path / "x.parquet"
    write_rows(path, SCENES[0], [value_of(SCENES[0], full=full) for full in (True, False)], {})

    def parse(row):
        if "table" not in row["condition"]:
            raise InputError("is missing", field="condition.table")

    with pytest.raises(InputError) as caught:
        read_results(path, parse, "scene", SCENES)
    assert str(caught.value) == f"{path}, line 2, field `condition.table`: is missing"


def test_without_the_extra_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(
        InputError, match=r"needs the package pyarrow: pip install 'deggflow\[data\]'"
    ):
        read_info(tmp_path / "x.parquet")  # fmt: skip


def test_episodes_lie_where_lerobot_looks_for_them(tmp_path):
    """Counters, places, statistics and texts; benchmarks/lerobot_reader.py reads the same by LeRobot itself."""
    form = EpisodeFormat("robot", 5, {"action": ("v", "w"), "observation.state": ("x",)})
    rng = np.random.default_rng(0)
    lengths, folder = (3, 1, 4), tmp_path / "set"
    values = [rng.normal(size=(n, 3)) for n in lengths]
    episodes = [Episode({"action": v[:, :2], "observation.state": v[:, 2:]}, k != 1, True, ("Do it.", "Do that.")[k // 2]) for k, v in enumerate(values)]  # fmt: skip
    assert write_lerobot(folder, form, iter(episodes)) == 3
    info = json.loads((folder / "meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == (
        "v3.0",
        3,
        8,
    )
    assert info["features"]["action"] == {"dtype": "float32", "shape": [2], "names": ["v", "w"]}
    place = {"chunk_index": 0, "file_index": 0}
    frames = arrow.parquet.read_table(folder / info["data_path"].format(**place)).to_pydict()
    assert set(frames) == set(info["features"])
    np.testing.assert_allclose(np.array(frames["action"]), np.concatenate(values)[:, :2], atol=1e-6)
    assert frames["index"] == list(range(8))
    assert frames["episode_index"] == [0, 0, 0, 1, 2, 2, 2, 2]
    assert frames["frame_index"] == [0, 1, 2, 0, 0, 1, 2, 3]
    assert frames["next.success"] == [k in (2, 7) for k in range(8)]
    np.testing.assert_allclose(frames["timestamp"][4:], [0, 0.2, 0.4, 0.6], atol=1e-7)
    entries = arrow.parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet")
    assert entries["dataset_from_index"].to_pylist() == [0, 3, 4]
    assert entries["dataset_to_index"].to_pylist() == [3, 4, 8]
    stats = json.loads((folder / "meta/stats.json").read_text())["action"]
    both = np.concatenate(values)[:, :2]
    for name, expected in (("mean", both.mean(0)), ("std", both.std(0)), ("max", both.max(0))):
        np.testing.assert_allclose(stats[name], expected, rtol=1e-12)
    with pytest.raises(InputError, match="exists; choose another --out"):
        write_lerobot(folder, form, iter(episodes))


def test_groups_that_were_read_are_let_go(tmp_path):
    """A table may be larger than memory: Arrow holds a small part of it at any time."""
    kind, path, held = SCENES[0], tmp_path / "many.parquet", []
    row = value_of(kind, full=True)
    assert write_rows(path, kind, iter([row] * 40), {"task": "a task"}) == 40
    table = arrow.parquet.read_table(path)
    plain = {"compression": "none", "use_dictionary": False, "write_page_checksum": True}
    with arrow.parquet.ParquetWriter(path, table.schema, **plain) as file:
        for _ in range(40):
            file.write_table(table)
    del table
    before = arrow.total_allocated_bytes()
    for number, _ in enumerate(table_rows(path, kind)):
        if number % 40 == 20:
            held.append(arrow.total_allocated_bytes() - before)
    assert len(held) == 40
    assert max(held) < path.stat().st_size / 10
