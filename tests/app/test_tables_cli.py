"""Tables as a user makes them: by `merge` and `export`, and back."""

import json

import pytest


@pytest.fixture(autouse=True)
def _needs_pyarrow():
    pytest.importorskip("pyarrow")


def test_merged_shards_become_a_table_that_can_be_certified_and_written_back(
    inside, tmp_path, small_weights
):
    arguments = ("tabletop", "generate", "--size", 4, "--count", 3, "--guidance", "none")
    arguments = (*arguments, "--weights", small_weights, "--out")
    assert inside(*arguments, "whole.jsonl").returncode == 0
    for k in (1, 2):
        assert inside(*arguments, f"{k}.jsonl", "--shard", f"{k}/2").returncode == 0
    assert inside("merge", "1.jsonl", "2.jsonl", "--out", "m.parquet").returncode == 0
    exported = inside("export", "m.parquet", "--out", "back.jsonl")
    assert exported.returncode == 0, exported.stderr
    for name in ("", ".run.json"):
        one, other = ((tmp_path / f"{each}.jsonl{name}") for each in ("whole", "back"))
        assert one.read_text() == other.read_text()
    certified = [inside("tabletop", "certify", f"{n}") for n in ("m.parquet", "whole.jsonl")]
    assert certified[0].stdout == certified[1].stdout
    refused = inside("export", "whole.jsonl", "--out", "m.parquet")
    assert (refused.returncode, "m.parquet: exists" in refused.stderr) == (2, True)
    (tmp_path / "2.jsonl").write_text("{}\n")
    refused = inside("merge", "1.jsonl", "2.jsonl", "--out", "n.parquet")
    assert refused.returncode == 2
    assert not (tmp_path / "n.parquet").exists()


def test_demonstrations_are_exported_by_their_keys_and_foreign_lines_refused(inside, tmp_path):
    made = inside("bridge", "data", "--out", "d", "--training", 2, "--validation", 1, "--sizes", 4)
    assert made.returncode == 0, made.stderr
    exported = inside("export", "d", "--out", "t")
    assert exported.returncode == 0, exported.stderr
    assert inside("export", "t/training.parquet", "--out", "back.jsonl").returncode == 0
    assert (tmp_path / "back.jsonl").read_text() == (tmp_path / "d/training.jsonl").read_text()
    (tmp_path / "x.jsonl").write_text(json.dumps({"a": 1}) + "\n")
    for options, hint in (
        ((), "is no line of a shipped task; name the line's task with --task"),
        (("--task", "bridge"), "is no line of the task bridge"),
        (("--task", "none"), "there is no task 'none'; known are tabletop, bridge"),
    ):
        refused = inside("export", "x.jsonl", "--out", "x.parquet", *options)
        assert (refused.returncode, hint in refused.stderr) == (2, True)
