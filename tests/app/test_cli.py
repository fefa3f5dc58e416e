"""The command line as a user runs it: processes, exit codes, files."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.oracle import refutes
from deggflow.view.tabletop import results, write_video


def conditions(path, *rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_help_reads_well_and_names_every_command(deggflow):
    text = deggflow("--help").stdout
    assert "tabletop" in text
    assert "demo" in text
    text = deggflow("tabletop", "--help").stdout
    for command in ("data", "train", "generate", "certify", "evaluate", "render"):
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


def test_results_go_to_stdout_and_repeat(deggflow, inside):
    arguments = ("tabletop", "generate", "--size", 5, "--count", 3, "--seed", 1)
    first, second = deggflow(*arguments), inside(*arguments)
    assert first.returncode == 0
    assert first.stdout == second.stdout
    assert len([json.loads(line) for line in first.stdout.splitlines()]) == 3


def test_damaged_compiled_programs_are_told_once_and_renewed(environment, tmp_path):
    cache = tmp_path / "cache"
    environment = {**environment, "DEGGFLOW_CACHE": str(cache)}

    def generate():
        command = [
            sys.executable,
            "-m",
            "deggflow.app.start",
            "tabletop",
            "generate",
            "--size",
            "2",
            "--guidance",
            "none",
        ]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    first = generate()
    programs = list((cache / "xla").iterdir())
    assert programs
    for path in programs:
        path.write_bytes(path.read_bytes()[:100])
    second, third = generate(), generate()
    assert first.stdout == second.stdout == third.stdout
    assert second.stderr.count("were damaged; they are compiled again") == 1
    assert "Warning" not in second.stderr
    assert third.stderr == first.stderr


def test_an_argument_with_a_nul_character_is_bad_input(inside):
    assert inside("tabletop", "certify", "a\0b").stderr == (
        "deggflow: an argument must not contain a NUL character\n"
    )


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
def test_bad_files_exit_with_2_in_one_line_and_touch_nothing(inside, tmp_path, name):
    content, hint = BAD[name]
    path, out = tmp_path / "bad.jsonl", tmp_path / "out.jsonl"
    path.write_bytes(content)
    before = {p.name for p in tmp_path.iterdir()}
    found = inside("tabletop", "generate", "--conditions", path, "--out", out)
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
        (("generate", "--size", "10001"), "--size must lie in [1, 10000]; got 10001"),
        (("generate", "--size", "4", "--count", "0"), "--count must"),
        (("generate", "--size", "4", "--max-draws", "0"), "--max-draws must"),
        (("generate", "--size", "4", "--seed", "-1"), "--seed must"),
        (
            ("generate", "--size", "4", "--evaluations", "0"),
            "--evaluations must lie in [1, 100]; got 0",
        ),
        (("generate", "--size", "4", "--guidance-phase", "later"), "guidance-phase"),
        (("evaluate", "--evaluations", "101"), "--evaluations must lie in [1, 100]; got 101"),
        (("generate", "--conditions", "no.jsonl"), "no.jsonl: can't be read: No such file"),
        (("generate", "--size", "four"), "four"),
        (("generate", "--size", "4", "--guidance", "magic"), "magic"),
        (("generate", "--size", "4", "--weights", "no.safetensors"), "--weights can't be used"),
        (("train", "--data", "nowhere", "--out", "run"), "nowhere/training.jsonl: can't be read"),
        (("train", "--data", ".", "--out", "run", "--steps", "7"), "`steps` must"),
        (("generate", "--size", "4", "--requirements", "magic"), "magic"),
        (("render", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify",), "scenes"),
        (("evaluate", "--sizes", "0"), "--sizes must"),
        (("evaluate", "--seed", "-1"), "--seed must"),
        (("data", "--out", "d", "--seed", "2000000000"), "--seed must"),
    ],
)
def test_bad_arguments_exit_with_2(inside, tmp_path, arguments, hint):
    found = inside("tabletop", *arguments)
    assert found.returncode == 2, found.stderr
    assert hint in found.stderr
    assert not any(tmp_path.iterdir())


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


def test_scenes_are_drawn_with_their_nominal_twins_video_and_model(inside, tmp_path, monkeypatch):
    """A video of every point of both generations; here of some of them, for it is the drawing that takes long."""
    import mujoco

    def write_some(path, condition, guided, *, left_poses, taus, **settings):
        assert len(guided) == len(left_poses) == len(taus) == 51
        some = slice(0, None, 10)
        left, right = left_poses[some], guided[some]
        write_video(path, condition, right, left_poses=left, taus=taus[some], **settings)

    monkeypatch.setattr(results, "write_video", write_some)
    assert inside("tabletop", "generate", "--size", 4, "--out", "s.jsonl").returncode == 0
    found = inside("tabletop", "render", "s.jsonl", "--out", "p", "--nominal", "--video", "--mjcf")
    assert found.returncode == 0, found.stderr
    assert [Path(line).suffix for line in found.stdout.split()] == [".png", ".mp4", ".xml"]
    assert all((tmp_path / line).stat().st_size > 1000 for line in found.stdout.split())
    mujoco.MjModel.from_xml_path(str(tmp_path / "p/scene_0001.xml"))
    scene = json.loads((tmp_path / "s.jsonl").read_text())
    scene["seed"] += 1  # not what this seed generates
    (tmp_path / "other.jsonl").write_text(json.dumps(scene) + "\n")
    refused = inside("tabletop", "render", "other.jsonl", "--nominal")
    assert refused.returncode == 2
    assert "other.jsonl, line 1: can't be generated again" in refused.stderr


def test_evaluation_prints_its_table_and_keeps_its_rows(inside, tmp_path):
    arguments = ("tabletop", "evaluate", "--cases", 20, "--sizes", 4, "--out", "rows.jsonl")
    found = inside(*arguments)
    assert found.returncode == 0, found.stderr
    (row,) = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert row["cases"] == 20
    assert row["refuted"] == 0
    assert row["satisfied"] == 20
    assert "100.0%" in found.stdout
    assert inside(*arguments).stdout == found.stdout


def test_data_and_training_from_the_command_line(inside, tmp_path):
    made = inside("tabletop", "data", "--out", "d", "--training", 20, "--validation", 5)
    assert made.returncode == 0, made.stderr
    trained = inside(
        *("tabletop", "train", "--data", "d", "--out", "run", "--steps", 500, "--batch", 4),
        *("--width", 8, "--rounds", 1, "--head-width", 8),
    )
    assert trained.returncode == 0, trained.stderr
    card = json.loads((tmp_path / "run/field.json").read_text())
    assert card["architecture"] == {"width": 8, "rounds": 1, "head_width": 8}
    assert card["data"]["training"] == 20
    assert (tmp_path / "run/curves.png").stat().st_size > 1000
    used = inside(
        *("tabletop", "generate", "--size", 4, "--weights", "run/field.safetensors"),
        *("--guidance", "none"),
    )
    assert used.returncode == 0, used.stderr
    more = ("tabletop", "train", "--data", "d", "--out", "run", "--steps", 1000, "--batch", 4)
    small = ("--rounds", 1, "--head-width", 8)
    wider = inside(*more, "--width", 9, *small)
    assert wider.returncode == 2
    assert "run/config.json: `architecture.width` is 9 here, 8 in the run" in wider.stderr
    extended = inside(*more, "--width", 8, *small)
    assert extended.returncode == 0, extended.stderr
    card = json.loads((tmp_path / "run/field.json").read_text())
    assert card["training"]["segments"] == [500, 1000]
    assert [line.split("--steps ")[1].split()[0] for line in card["commands"][1:]] == [
        "500",
        "1000",
    ]
    (tmp_path / "run/config.json").write_text("[]")
    refused = inside(*more, "--width", 8, *small)
    assert refused.returncode == 2
    assert "run/config.json: must be a JSON object; got []" in refused.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("data", "--out", "o", "--training", 4, "--validation", 2),
        ("generate", "--size", 4, "--guidance", "none", "--out", "o/a.jsonl"),
    ],
)
def test_a_folder_removed_as_the_last_line_is_printed_is_noticed(
    inside, tmp_path, monkeypatch, arguments
):
    """Between the last look at the files and the line that names them, anything may happen."""
    printed = Console.print

    def remove(console, *objects, **settings):
        if " in o" in str(objects):
            shutil.rmtree(tmp_path / "o")
        printed(console, *objects, **settings)

    monkeypatch.setattr(Console, "print", remove)
    ended = inside("tabletop", *arguments)
    assert ended.returncode == 2
    assert "was removed while it was being written" in ended.stderr


def test_baselines_are_compared_and_unknown_ones_refused(inside, tmp_path):
    ways = ("penalty gradient", "rejection sampling")
    small = ("tabletop", "baselines", "--cases", 3, "--sizes", 3, "--chosen", "--out", "rows.jsonl")
    found = inside(*small, "--methods", *ways)
    assert found.returncode == 0, found.stderr
    written = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert [row["method"] for row in written] == list(ways)
    for name in ways:
        assert name in found.stdout
    refused = inside("tabletop", "baselines", "--methods", "magic")
    assert refused.returncode == 2
    assert "no method 'magic'" in refused.stderr
