"""`deggflow tabletop generate` as a user runs it: what is certified, what is impossible, runs that are killed and go on."""

import json
import signal
import time

import numpy as np
import pytest

from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.oracle import refutes


def conditions(path, *rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_scenes_of_a_file_are_certified_and_no_claim_is_refuted(deggflow, tmp_path):
    rows = [
        {"objects": ["laptop", "desk_lamp", "handled_mug"]},
        {
            "objects": ["laptop", "potted_plant", "pen_cup", "teacup"],
            "requirements": {"laptop": {"direction": 3.14, "radius_scale": 1.2}},
            "table": {"width": 1.4, "depth": 0.94},
        },
    ]
    path = conditions(tmp_path / "wanted.jsonl", *rows)
    found = deggflow("tabletop", "generate", "--conditions", path, "--seed", 5, "--out", "s.jsonl")
    assert found.returncode == 0, found.stderr
    assert "2 of 2 scenes satisfy every requirement" in found.stderr
    lines = [json.loads(line) for line in (tmp_path / "s.jsonl").read_text().splitlines()]
    assert [line["condition"] for line in lines] == rows  # as given, in order
    for line, scene in zip(lines, read_scenes(tmp_path / "s.jsonl"), strict=True):
        assert [item["name"] for item in line["objects"]] == line["condition"]["objects"]
        assert line["certificate"]["satisfied"]
        assert line["seed"] == 5
        assert not refutes(scene.condition, scene.poses)


def test_a_hall_is_a_scene_like_any_other(inside, tmp_path):
    """More objects than types: generated, certified anew and drawn by the same commands."""
    made = inside("tabletop", "generate", "--size", 20, "--seed", 3, "--out", "hall.jsonl")
    assert made.returncode == 0, made.stderr
    assert "1 of 1 scene satisfies every requirement" in made.stderr
    large = json.loads((tmp_path / "hall.jsonl").read_text())
    assert len(set(large["condition"]["objects"])) == 20
    assert large["certificate"]["generation"]["requirements"][0]["name"] == "affordance"
    assert inside("tabletop", "certify", "hall.jsonl").returncode == 0
    drawn = inside("tabletop", "render", "hall.jsonl", "--out", "p", "--nominal")
    assert drawn.returncode == 0, drawn.stderr
    assert (tmp_path / drawn.stdout.strip()).stat().st_size > 10_000


def test_the_nominal_field_alone_never_fails_the_command(inside):
    found = inside(
        "tabletop", "generate", "--size", 8, "--count", 40, "--guidance", "none", "--seed", 2
    )
    scenes = [json.loads(line) for line in found.stdout.splitlines()]
    assert found.returncode == 0
    assert not all(scene["certificate"]["satisfied"] for scene in scenes)
    assert {scene["certificate"]["draws"] for scene in scenes} == {1}


@pytest.mark.parametrize(
    "condition",
    [
        {"objects": ["laptop", "desk_lamp"], "table": {"width": 0.1, "depth": 0.1}},
        {
            "objects": [
                "drawer_organizer",
                "teacup",
                "desk_lamp",
                "laptop",
                "potted_plant",
                "handled_mug",
                "drawing_board",
                "scissors",
                "compact_printer",
                "pencil_case",
                "tissue_box",
                "pen_cup",
            ],
            "requirements": "all",
        },
    ],
    ids=["tiny table", "huge regions"],
)
def test_the_impossible_is_told_with_what_was_closest(inside, tmp_path, condition):
    if condition.get("requirements") == "all":
        condition["requirements"] = {name: {"radius_scale": 3.0} for name in condition["objects"]}
    path = conditions(tmp_path / "wanted.jsonl", condition)
    found = inside("tabletop", "generate", "--conditions", path, "--max-draws", 3)
    assert found.returncode == 3
    assert "0 of 1 scene satisfies every requirement" in found.stderr
    certificate = json.loads(found.stdout)["certificate"]
    assert certificate["satisfied"] is False
    assert certificate["draws"] == 3
    assert certificate["min_margin"] < 0
    assert any(name in certificate["reason"] for name in condition["objects"])


def test_a_trace_is_kept_with_every_requirement(inside, tmp_path):
    """Of the shared circle too; the table that is read back speaks of both."""
    arguments = ("--size", 4, "--requirements", "balanced", "--trace", "--seed", 2)
    made = inside("tabletop", "generate", *arguments, "--out", "s.jsonl")
    assert made.returncode == 0, made.stderr
    (line,) = [json.loads(line) for line in (tmp_path / "s.jsonl").read_text().splitlines()]
    assert line["condition"]["balance"] == {"x": 0.0, "y": 0.0, "radius": 0.05}
    made = line["certificate"]["generation"]
    names = [each["name"] for each in made["requirements"]]
    assert names == ["affordance", "balance"]
    tau, value, bound, limit = (
        np.array(made["trace"][part]) for part in ("tau", "value", "bound", "limit")
    )
    assert (len(tau), tau[0], tau[-1]) == (51, 0.0, 1.0)
    assert np.all(np.diff(tau) > 0)
    assert value.shape == bound.shape == limit.shape == (51, 2)
    np.testing.assert_array_equal(value[-1], [each["value"] for each in made["requirements"]])
    np.testing.assert_array_equal(limit[-1], [each["limit"] for each in made["requirements"]])
    excess = (value - limit).max(axis=0)
    rounding = 1e-6 * np.abs(value).max(axis=0)
    assert np.all(
        excess
        <= [each["excess"] + r for each, r in zip(made["requirements"], rounding, strict=True)]
    )
    found = inside("tabletop", "certify", "s.jsonl")
    assert found.returncode == 0
    assert all(name in found.stdout for name in names)
    assert "hypotheses hold at all " in found.stdout or not made["hypotheses_hold"]
    other = inside("tabletop", "generate", *arguments[:4], "--seed", 2, "--out", "s.jsonl")
    assert other.returncode == 2
    assert "begun with trace = true, not false" in other.stderr


def test_evaluations_and_phase_of_a_run_are_those_it_was_begun_with(inside, tmp_path):
    """They are needed to draw its scenes with their nominal twins, too."""
    arguments = ("--size", 4, "--evaluations", 6, "--guidance-phase", "during")
    made = inside("tabletop", "generate", *arguments, "--out", "s.jsonl")
    assert made.returncode == 0, made.stderr
    assert inside("tabletop", "certify", "s.jsonl").returncode == 0
    other = inside("tabletop", "generate", *arguments[:4], "--out", "s.jsonl")
    assert other.returncode == 2
    assert "begun with guidance_phase = during, not after" in other.stderr
    render = (
        "tabletop",
        "render",
        "s.jsonl",
        "--out",
        "p",
        "--nominal",
        "--renderer",
        "matplotlib",
    )
    assert inside(*render, *arguments[2:]).returncode == 0
    assert (tmp_path / "p" / "scene_0001.png").exists()
    other = inside(*render)
    assert other.returncode == 2
    assert "--evaluations and --guidance-phase" in other.stderr


@pytest.mark.slow
def test_a_killed_generation_loses_no_line_and_ends_the_same(
    deggflow, inside, tmp_path, small_weights
):
    arguments = ("tabletop", "generate", "--size", 4, "--count", 1100, "--weights", small_weights)
    arguments = (*arguments, "--guidance", "none")
    assert inside(*arguments, "--out", "whole.jsonl").returncode == 0
    rng, out = np.random.default_rng(0), tmp_path / "killed.jsonl"
    before = b""
    for _ in range(2):
        process = deggflow(*arguments, "--out", out, start=True)
        while process.poll() is None:
            if out.exists() and out.stat().st_size > len(before):
                break
            time.sleep(0.02)
        time.sleep(rng.uniform(0, 0.5))
        process.send_signal(signal.SIGKILL)
        process.wait()
        now = out.read_bytes()
        assert now.startswith(before)
        before = now[: now.rfind(b"\n") + 1]
        assert before
    assert inside(*arguments, "--out", out).returncode == 0
    assert out.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()
    with out.open("r+b") as file:  # as a kill in the middle of a write would leave it
        file.truncate(out.stat().st_size * 3 // 5)
    assert inside(*arguments, "--out", out).returncode == 0
    assert out.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()
    assert deggflow(*arguments, "--out", out).returncode == 0  # complete: nothing is added
    assert len(out.read_text().splitlines()) == 1100
    other = deggflow(*arguments[:-2], "--out", out)
    assert other.returncode == 2
    assert "begun with guidance" in other.stderr
