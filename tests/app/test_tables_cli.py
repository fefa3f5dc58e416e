"""Tables as a user makes them: by `merge` and `export`, and back."""

import json

import numpy as np
import pytest

pq = pytest.importorskip("pyarrow.parquet")


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


def plan_of(robots, name):
    """A line of a plan whose robots go straight."""
    ends = [([-0.8, 0.3 * k - 0.5], [0.8, 0.3 * k - 0.5]) for k in range(robots)]
    paths = [np.linspace(*each, 64).tolist() for each in ends]
    condition = {"map": name, "robots": [{"start": start, "goal": goal} for start, goal in ends]}
    certificate = {
        "satisfied": robots < 3,
        "min_margin": 0.1,
        "violation": 0.0,
        "draws": 1,
        "reason": None,
    }
    return {"condition": condition, "paths": paths, "certificate": certificate, "seed": 0}  # fmt: skip


def test_plans_are_episodes_whose_tasks_name_their_maps(inside, tmp_path):
    plans = [plan_of(2, "empty"), plan_of(2, "conveyor"), plan_of(2, "empty")]
    (tmp_path / "plans.jsonl").write_text("".join(json.dumps(plan) + "\n" for plan in plans))
    exported = inside("export", "plans.jsonl", "--out", "set", "--lerobot")
    assert exported.returncode == 0, exported.stderr
    frames = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    paths = np.array([plan["paths"] for plan in plans])  # plans x robots x waypoints x 2
    states = paths.swapaxes(1, 2).reshape(3, 64, 4)
    np.testing.assert_allclose(
        frames["observation.state"], states[:, :-1].reshape(-1, 4), atol=1e-6
    )
    np.testing.assert_allclose(frames["action"], np.diff(states, axis=1).reshape(-1, 4), atol=1e-6)
    assert frames["task_index"] == [0] * 63 + [1] * 63 + [0] * 63
    tasks = pq.read_table(tmp_path / "set/meta/tasks.parquet")["task"].to_pylist()
    assert tasks == [f"Reach the goals on the map {name}." for name in ("empty", "conveyor")]
    with (tmp_path / "plans.jsonl").open("a") as lines:
        lines.write(json.dumps(plan_of(3, "empty")) + "\n")
    refused = inside("export", "plans.jsonl", "--out", "other", "--lerobot")
    assert refused.returncode == 2
    assert "line 4: has 6 numbers in observation.state, and the first episode 4" in refused.stderr
    assert not list(tmp_path.glob("*other*"))
