"""What the studio says of scenes is what the commands say, and what independent geometry finds."""

import base64
import json
import math
import shlex
from io import BytesIO
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from PIL import Image

from deggflow.jsonl import InputError, read_lines
from deggflow.studio.desk import ClosedError
from deggflow.tasks.tabletop.consistency import contradictions
from deggflow.tasks.tabletop.formats import parse_condition, parse_scene
from deggflow.tasks.tabletop.oracle import least_margin, refutes

CONDITION = {
    "objects": ["laptop", "desk_lamp", "handled_mug", "potted_plant"],
    "requirements": {"laptop": {"direction": 3.1, "radius_scale": 1.2}},
}
CROWDED = {
    "objects": ["drawer_organizer", "laptop", "compact_printer", "potted_plant", "drawing_board"],
    "table": {"width": 0.5, "depth": 0.4},
}


def poses_of(line):
    return [[item["x"], item["y"], item["theta"]] for item in json.loads(line)["objects"]]


@pytest.fixture(scope="module")
def made(desk):
    fields = {"condition": CONDITION, "seed": 3, "max_draws": 8, "draw": None}
    return desk.answer("generate", fields, lambda: None)


def test_a_scene_is_what_its_command_makes(made, inside, tmp_path):
    """To the last bit, and the command is what the page shows."""
    first, second = made["command"].split("\n")
    words = shlex.split(first)
    assert words[0] == "echo"
    assert words[2:] == [">", "condition.jsonl"]
    (tmp_path / "condition.jsonl").write_text(words[1] + "\n")
    program, *arguments = shlex.split(second)
    assert program == "deggflow"
    assert inside(*arguments).returncode == 0
    assert (tmp_path / "scene.jsonl").read_text() == made["line"] + "\n"


def test_a_claim_is_confirmed_by_the_oracle(made):
    line = json.loads(made["line"])
    scene = parse_scene(line)
    assert scene.certificate.satisfied
    assert made["judgement"]["satisfied"]
    assert not refutes(scene.condition, scene.poses)
    assert not contradictions(line)
    assert made["judgement"]["oracle_margin"] == least_margin(scene.condition, scene.poses)


def test_values_on_the_way_stay_below_their_limits(made):
    trace = {name: np.array(made["trace"][name]) for name in ("tau", "value", "limit")}
    assert made["trace"]["names"] == ["affordance"]
    assert trace["tau"][[0, -1]].tolist() == [0.0, 1.0]
    assert (trace["value"][1:] <= trace["limit"][1:] * (1 + 1e-6)).all()


def test_the_replay_ends_at_the_scene_and_begins_at_the_nominal_one(ask, made):
    """Where guidance begins; the nominal replay begins at z(0)."""
    poses = poses_of(made["line"])
    replay = ask("replay", condition=CONDITION, seed=3, draw=made["draw"], poses=poses)
    assert replay["tau"][0] == 0
    assert replay["tau"][-1] == 1
    assert len(replay["tau"]) == len(replay["nominal"]) == len(replay["guided"]) == 51
    assert replay["apart"] < 0.05  # another program rounds differently
    np.testing.assert_allclose(replay["guided"][-1], poses, atol=1e-5)
    assert not np.allclose(replay["nominal"][0], replay["nominal"][-1], atol=0.1)
    np.testing.assert_allclose(replay["guided"][0], made["nominal"]["poses"], atol=1e-3)
    np.testing.assert_allclose(replay["nominal"][-1], made["nominal"]["poses"], atol=1e-3)


def test_what_cannot_be_met_is_named(ask):
    found = ask("generate", condition=CROWDED, seed=0, max_draws=2, draw=None)
    judgement, certificate = found["judgement"], json.loads(found["line"])["certificate"]
    assert not judgement["satisfied"]
    assert not certificate["satisfied"]
    assert certificate["draws"] == 2
    assert len(found["refused"]) == 2
    assert judgement["breaches"][0] in certificate["reason"]
    assert judgement["margins"][0]["margin"] == judgement["min_margin"] < 0


def test_draws_can_be_looked_at_one_by_one(ask, made):
    same = ask("generate", condition=CONDITION, seed=3, max_draws=8, draw=made["draw"])
    assert same["line"] == made["line"]
    other = ask("generate", condition=CONDITION, seed=3, max_draws=8, draw=made["draw"] + 1)
    assert poses_of(other["line"]) != poses_of(made["line"])
    assert other["command"] is None  # the command keeps the first that is satisfied


def test_an_object_moved_by_hand_breaks_its_promises(ask, made):
    poses = poses_of(made["line"])
    poses[1] = [poses[0][0], poses[0][1], 0.0]
    judgement = ask("judge", condition=CONDITION, poses=poses)
    assert not judgement["satisfied"]
    assert any("laptop and desk_lamp overlap" in each for each in judgement["breaches"])
    assert judgement["outlined"] == [0, 1]
    line = ask("line", condition=CONDITION, poses=poses, seed=3)["line"]
    assert not contradictions(json.loads(line))
    assert not json.loads(line)["certificate"]["satisfied"]


def test_margins_are_where_they_are_shown(made):
    """A positive margin is as long as the line that shows it."""
    for row in made["judgement"]["margins"]:
        if row["margin"] > 0:
            assert math.dist(*row["gap"]) == pytest.approx(row["margin"], abs=3e-5), row


def test_a_closed_page_stops_the_draws(desk):
    draws = []

    def check():
        draws.append(1)
        raise ClosedError

    fields = {"condition": CROWDED, "seed": 0, "max_draws": 8, "draw": None}
    with pytest.raises(ClosedError):
        desk.answer("generate", fields, check)
    assert len(draws) == 1


BAD_LINES = {
    "unknown object": '{"objects": ["lapdog"]}',
    "unknown key": '{"objects": ["laptop"], "tabel": {}}',
    "twice": '{"objects": ["laptop"], "objects": ["laptop"]}',
    "not finite": '{"objects": ["laptop"], "table": {"width": 1e999, "depth": 1}}',
    "not JSON": "{",
    "a number": "3",
}


@pytest.mark.parametrize("text", BAD_LINES.values(), ids=BAD_LINES)
def test_a_bad_file_has_the_errors_of_the_commands(ask, tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    content = '{"objects": ["laptop"]}\n' + text + "\n"
    (tmp_path / "wishes.jsonl").write_text(content)
    with pytest.raises(InputError) as expected:
        read_lines("wishes.jsonl", parse_condition, "tabletop condition")
    with pytest.raises(InputError) as found:
        ask("open", name="wishes.jsonl", text=content)
    assert str(found.value) == str(expected.value)
    assert str(found.value).startswith("wishes.jsonl, line 2")


def test_a_saved_scene_is_opened_again(ask, made):
    (row,) = ask("open", name="scene.jsonl", text=made["line"] + "\n")["rows"]
    assert row["line"] == made["line"]
    (row,) = ask("open", name="wish.jsonl", text=json.dumps(CONDITION))["rows"]
    assert row["condition"] == CONDITION


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "the file is empty; it must hold one tabletop condition or scene a line"),
        ('{"objects": ["laptop", "laptop#2"]}', "field `objects`: the studio shows up to 12"),
        ('{"objects": ["laptop"]}\n' * 201, "has 201 lines; the studio opens at most 200"),
        ("\ud800", "not UTF-8 text"),
    ],
    ids=["empty", "large", "long", "surrogate"],
)
def test_files_that_the_studio_does_not_open(ask, text, error):
    with pytest.raises(InputError, match=error):
        ask("open", name="file.jsonl", text=text)


def test_every_export_opens_again(ask, made):
    poses = poses_of(made["line"])
    contents = {
        kind: base64.b64decode(
            ask("export", kind=kind, condition=CONDITION, poses=poses)["content"]
        )
        for kind in ("svg", "png", "mjcf")
    }
    assert ElementTree.fromstring(contents["svg"]).tag.endswith("svg")
    assert Image.open(BytesIO(contents["png"])).size == (960, 720)
    model = mujoco.MjModel.from_xml_string(contents["mjcf"].decode())
    for name, (x, y, _) in zip(CONDITION["objects"], poses, strict=True):
        assert model.body(name).pos[:2] == pytest.approx([x, y], abs=1e-5)


@pytest.mark.parametrize(
    ("what", "fields", "error"),
    [
        ("dance", {}, "field `ask`: must be one of library, generate"),
        ("generate", {"condition": CONDITION, "seed": 0, "max_draws": 8}, "field `draw`: is missing"),
        ("generate", {"condition": CONDITION, "seed": -1, "max_draws": 8, "draw": None}, "field `seed`"),
        ("generate", {"condition": CONDITION, "seed": 0, "max_draws": 99, "draw": None}, "field `max_draws`"),
        ("generate", {"condition": {"objects": []}, "seed": 0, "max_draws": 8, "draw": None}, "field `condition.objects`"),
        ("judge", {"condition": CONDITION, "poses": [[0, 0, 0]]}, "field `poses`: must hold 4 poses"),
        ("judge", {"condition": CONDITION, "poses": [[0, 0]] * 4}, r"field `poses\[0\]`: must hold x, y and theta"),
        ("judge", {"condition": CONDITION, "poses": [[0, 0, 1e300]] * 4}, r"field `poses\[0\]\[2\]`"),
        ("export", {"kind": "../x", "condition": CONDITION, "poses": [[0, 0, 0]] * 4}, "field `kind`"),
        ("draw", {"size": 8, "family": "odd", "seed": 0}, "field `family`"),
        ("judge", {"condition": CONDITION, "poses": [], "extra": 1}, "field `extra`: unknown key"),
    ],
)  # fmt: skip
def test_what_a_page_asks_is_checked(ask, what, fields, error):
    with pytest.raises(InputError, match=error):
        ask(what, **fields)
