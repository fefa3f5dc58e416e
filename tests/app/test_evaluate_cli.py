"""Pictures, evaluations, training and comparisons of the tabletop from the command line."""

import json
from pathlib import Path

from deggflow.view.tabletop import results, write_video


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
