"""`--shard` and `deggflow merge` as a user runs them."""

import json


def test_shards_are_generated_and_merged(inside, tmp_path, small_weights):
    arguments = ("tabletop", "generate", "--size", 4, "--count", 3, "--guidance", "none")
    arguments = (*arguments, "--weights", small_weights)
    whole = inside(*arguments)
    for k in (1, 2):
        found = inside(*arguments, "--out", f"{k}.jsonl", "--shard", f"{k}/2")
        assert found.returncode == 0, found.stderr
    merged = inside("merge", "2.jsonl", "1.jsonl", "--out", "m.jsonl")
    assert merged.returncode == 0, merged.stderr
    assert "3 lines of 2 shards are in m.jsonl" in merged.stderr
    assert (tmp_path / "m.jsonl").read_text() == whole.stdout
    made_with = json.loads((tmp_path / "m.jsonl.run.json").read_text())["made_with"]
    assert len(made_with["weights"]) == 64
    again = inside(*arguments, "--out", "m.jsonl")  # the merged file is that of the whole run
    assert again.returncode == 0, again.stderr
    refused = inside("merge", "1.jsonl", "--out", "n.jsonl")
    assert (refused.returncode, refused.stderr) == (2, "deggflow: 1 of 2 shards are missing: 2\n")


def test_rows_that_are_only_printed_have_no_shards(inside):
    for command in (("tabletop", "evaluate"), ("tabletop", "baselines"), ("bridge", "evaluate")):
        refused = inside(*command, "--shard", "1/2")
        assert refused.returncode == 2
        assert "--shard goes with --out" in refused.stderr
