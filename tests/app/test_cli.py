"""The command line as a user runs it: processes, exit codes, files."""

import json
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.oracle import refutes


def conditions(path, *rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_help_reads_well_and_names_every_command(deggflow):
    text = deggflow("--help").stdout
    assert "tabletop" in text
    assert "demo" in text
    text = deggflow("tabletop", "--help").stdout
    for command in ("data", "train", "generate", "evaluate", "render"):
        assert command in text


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


def test_results_go_to_stdout_and_repeat(deggflow):
    arguments = ("tabletop", "generate", "--size", 5, "--count", 3, "--seed", 1)
    first, second = deggflow(*arguments), deggflow(*arguments)
    assert first.returncode == 0
    assert first.stdout == second.stdout
    assert len([json.loads(line) for line in first.stdout.splitlines()]) == 3


def test_the_nominal_field_alone_never_fails_the_command(deggflow):
    found = deggflow(
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
def test_the_impossible_is_told_with_what_was_closest(deggflow, tmp_path, condition):
    if condition.get("requirements") == "all":
        condition["requirements"] = {name: {"radius_scale": 3.0} for name in condition["objects"]}
    path = conditions(tmp_path / "wanted.jsonl", condition)
    found = deggflow("tabletop", "generate", "--conditions", path, "--max-draws", 3)
    assert found.returncode == 3
    assert "0 of 1 scene satisfies every requirement" in found.stderr
    certificate = json.loads(found.stdout)["certificate"]
    assert certificate["satisfied"] is False
    assert certificate["draws"] == 3
    assert certificate["min_margin"] < 0
    assert any(name in certificate["reason"] for name in condition["objects"])


BAD = {
    "truncated": (b'{"objects": ["laptop"', "not JSON"),
    "unknown object": (b'{"objects": ["sofa"]}', "objects[0]"),
    "duplicate object": (b'{"objects": ["laptop", "laptop"]}', "objects[1]"),
    "NaN": (b'{"objects": ["laptop"], "table": {"width": NaN, "depth": 1}}', "NaN"),
    "negative scale": (
        b'{"objects": ["laptop"], "requirements": {"laptop": {"radius_scale": -1}}}',
        "requirements.laptop.radius_scale",
    ),
    "wrong type": (b'{"objects": "laptop"}', "objects"),
    "empty": (b"", "empty"),
    "huge": (b'{"objects": ["' + b"x" * 5_000_000 + b'"]}', "longer than"),
    "binary": (bytes(range(256)), "line 1"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_exit_with_2_in_one_line_and_touch_nothing(deggflow, tmp_path, name):
    content, hint = BAD[name]
    path, out = tmp_path / "bad.jsonl", tmp_path / "out.jsonl"
    path.write_bytes(content)
    before = {p.name for p in tmp_path.iterdir()}
    found = deggflow("tabletop", "generate", "--conditions", path, "--out", out)
    assert found.returncode == 2
    assert found.stdout == ""
    assert len(found.stderr.splitlines()) == 1
    assert "bad.jsonl, line 1" in found.stderr
    assert hint in found.stderr
    assert {p.name for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("generate",), "--conditions FILE or --size"),
        (("generate", "--size", "13"), "--size must lie in [1, 12]; got 13"),
        (("generate", "--size", "4", "--count", "0"), "--count must"),
        (("generate", "--size", "4", "--max-draws", "0"), "--max-draws must"),
        (("generate", "--size", "4", "--seed", "-1"), "--seed must"),
        (("generate", "--conditions", "no.jsonl"), "no.jsonl: can't be read: No such file"),
        (("generate", "--size", "four"), "four"),
        (("generate", "--size", "4", "--guidance", "magic"), "magic"),
        (("generate", "--size", "4", "--weights", "no.safetensors"), "--weights can't be used"),
        (("train", "--data", "nowhere", "--out", "run"), "nowhere/training.jsonl: can't be read"),
        (("train", "--data", ".", "--out", "run", "--steps", "7"), "`steps` must"),
        (("render", "no.jsonl"), "no.jsonl: can't be read"),
        (("evaluate", "--sizes", "0"), "--sizes must"),
        (("evaluate", "--seed", "-1"), "--seed must"),
        (("data", "--out", "d", "--seed", "2000000000"), "--seed must"),
    ],
)
def test_bad_arguments_exit_with_2(deggflow, tmp_path, arguments, hint):
    found = deggflow("tabletop", *arguments)
    assert found.returncode == 2, found.stderr
    assert hint in found.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_a_killed_generation_loses_no_line_and_ends_the_same(deggflow, tmp_path):
    arguments = ("tabletop", "generate", "--size", 4, "--count", 1600, "--seed", 3)
    assert deggflow(*arguments, "--out", "whole.jsonl").returncode == 0
    rng, out = np.random.default_rng(0), tmp_path / "killed.jsonl"
    before = b""
    for _ in range(2):
        process = deggflow(*arguments, "--out", out, start=True)
        deadline = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < deadline:
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
    assert deggflow(*arguments, "--out", out).returncode == 0
    assert out.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()
    with out.open("r+b") as file:  # as a kill in the middle of a write would leave it
        file.truncate(out.stat().st_size * 3 // 5)
    assert deggflow(*arguments, "--out", out).returncode == 0
    assert out.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()
    assert deggflow(*arguments, "--out", out).returncode == 0  # complete: nothing is added
    assert len(out.read_text().splitlines()) == 1600
    other = deggflow(*arguments, "--guidance", "none", "--out", out)
    assert other.returncode == 2
    assert "begun with guidance" in other.stderr


def test_scenes_are_drawn_with_their_nominal_twins_video_and_model(deggflow, tmp_path):
    import mujoco

    assert deggflow("tabletop", "generate", "--size", 4, "--out", "s.jsonl").returncode == 0
    found = deggflow(
        "tabletop", "render", "s.jsonl", "--out", "p", "--nominal", "--video", "--mjcf"
    )
    assert found.returncode == 0, found.stderr
    assert [Path(line).suffix for line in found.stdout.split()] == [".png", ".mp4", ".xml"]
    assert all((tmp_path / line).stat().st_size > 1000 for line in found.stdout.split())
    mujoco.MjModel.from_xml_path(str(tmp_path / "p/scene_0001.xml"))
    scene = json.loads((tmp_path / "s.jsonl").read_text())
    scene["seed"] += 1  # not what this seed generates
    (tmp_path / "other.jsonl").write_text(json.dumps(scene) + "\n")
    refused = deggflow("tabletop", "render", "other.jsonl", "--nominal")
    assert refused.returncode == 2
    assert "other.jsonl, line 1: can't be generated again" in refused.stderr


def test_evaluation_prints_its_table_and_keeps_its_rows(deggflow, tmp_path):
    arguments = ("tabletop", "evaluate", "--cases", 20, "--sizes", 4, "--out", "rows.jsonl")
    found = deggflow(*arguments)
    assert found.returncode == 0, found.stderr
    (row,) = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert row["cases"] == 20
    assert row["refuted"] == 0
    assert row["satisfied"] == 20
    assert "100.0%" in found.stdout
    assert deggflow(*arguments).stdout == found.stdout


def test_data_and_training_from_the_command_line(deggflow, tmp_path):
    made = deggflow("tabletop", "data", "--out", "d", "--training", 20, "--validation", 5)
    assert made.returncode == 0, made.stderr
    trained = deggflow(
        *("tabletop", "train", "--data", "d", "--out", "run", "--steps", 500, "--batch", 4),
        *("--width", 8, "--rounds", 1, "--head-width", 8),
    )
    assert trained.returncode == 0, trained.stderr
    card = json.loads((tmp_path / "run/field.json").read_text())
    assert card["architecture"] == {"width": 8, "rounds": 1, "head_width": 8}
    assert card["data"]["training"] == 20
    assert (tmp_path / "run/curves.png").stat().st_size > 1000
    used = deggflow(
        *("tabletop", "generate", "--size", 4, "--weights", "run/field.safetensors"),
        *("--guidance", "none"),
    )
    assert used.returncode == 0, used.stderr
