"""What the studio says of bridge trials is what the commands say, and what the independent replay finds."""

import base64
import json
import math
import shlex
from io import BytesIO
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from imageio_ffmpeg import count_frames_and_secs
from PIL import Image

from deggflow.jsonl import InputError
from deggflow.studio.filming import draw
from deggflow.tasks.bridge.oracle import refutation

SETTINGS = {"seed": 1, "max_draws": 8, "speed_limit": None}


@pytest.fixture(scope="module")
def bridge(bridge_desk):
    def asking(what, tell=lambda part: None, **fields):
        return bridge_desk.answer(what, fields, lambda: None, tell)

    return asking


@pytest.fixture(scope="module")
def condition(bridge):
    return bridge("random", size=4, seed=3)["condition"]


@pytest.fixture(scope="module")
def ran(bridge, condition):
    parts = []
    answer = bridge("run", tell=parts.append, condition=condition, **SETTINGS)
    return parts, answer, json.loads(answer["line"])


def test_policies_are_told_one_by_one_and_make_the_trial(ran):
    parts, answer, trial = ran
    parts = json.loads(json.dumps(parts))
    assert [part["policy"] for part in parts] == trial["certificate"]["policies"]
    told = [pose for part in parts for pose in part["poses"]]
    np.testing.assert_allclose(told, trial["poses"][1:], atol=1e-12)  # these are integrated at once
    assert trial["certificate"]["satisfied"]
    assert answer["refuted"] is refutation(trial) is None
    assert answer["nominal"]["poses"][0] == trial["poses"][0]


def test_the_trial_is_what_its_command_makes(ran, inside, tmp_path):
    first, second = ran[1]["command"].split("\n")
    (tmp_path / "condition.jsonl").write_text(shlex.split(first)[1] + "\n")
    assert inside(*shlex.split(second)[1:]).returncode == 0
    assert (tmp_path / "trial.jsonl").read_text() == ran[1]["line"] + "\n"


def test_the_course_of_a_policy_ends_at_its_record(bridge, ran):
    line, record = ran[1]["line"], ran[2]["certificate"]["policies"][1]
    course = bridge("course", line=line, number=0, policy=1)
    assert (course["tau"][0], course["tau"][-1]) == (0.0, 1.0)
    ends = [course[name][-1] for name in ("q_task", "beta_task", "q_safe", "beta_safe")]
    recorded = [record["q_task"], record["bound"], record["q_safe"], 0.0]
    np.testing.assert_allclose(
        ends, recorded, atol=1e-4
    )  # another program, which rounds differently
    with pytest.raises(InputError, match="field `policy`: must be one of the trial's"):
        bridge("course", line=line, number=0, policy=99)
    with pytest.raises(InputError, match="can't be generated again from its seed and line"):
        bridge("course", line=line, number=5, policy=1)


def test_a_blocked_trial_says_which_robot_and_which_requirement(bridge, condition):
    """The robots push at the front end: they get to the gap before the plank bridges it."""
    contacts = [[2.0, -0.36], [2.0, 0.36], [1.0, -0.36], [1.0, 0.36]]
    asked = {"condition": {**condition, "contacts": contacts}, **SETTINGS, "max_draws": 1}
    answer = bridge("run", **asked)
    trial = json.loads(answer["line"])
    assert not trial["outcome"]["success"]
    assert trial["outcome"]["reason"].startswith("blocked at policy ")
    assert "q_safe misses its bound" in trial["outcome"]["reason"]
    assert "robot" in trial["outcome"]["reason"]
    assert answer["refuted"] is None


def test_where_a_trial_cannot_begin_or_end_is_said(bridge, condition):
    assert bridge("placed", condition=condition) == {"start": None, "goal": None}
    outside = {
        **condition,
        "plank": {"x": -6.5, "y": 0.0, "theta": 0.0},
        "goal": condition["plank"],
    }
    assert bridge("placed", condition=outside) == {
        "start": "the plank leaves the workspace",
        "goal": "the plank does not bridge the gap",
    }


def test_files_are_read_as_by_the_commands(bridge, condition, ran):
    text = f"{ran[1]['line']}\n{json.dumps(condition)}\n"
    trial, start = bridge("open", name="t.jsonl", text=text)["rows"]
    assert (json.loads(trial["line"]), trial["refuted"]) == (ran[2], None)
    assert start == {"condition": condition}
    tampered = {**ran[2], "outcome": {"success": False, "reason": "robot 1 enters the gap"}}
    (row,) = bridge("open", name="t.jsonl", text=json.dumps(tampered))["rows"]
    assert row["refuted"] is not None
    with pytest.raises(InputError, match=r"^t\.jsonl, line 1, field `contacts`"):
        bridge("open", name="t.jsonl", text=json.dumps({**condition, "contacts": []}))


def test_every_export_opens_again(bridge, ran):
    def content(kind):
        return base64.b64decode(bridge("export", kind=kind, line=ran[1]["line"])["content"])

    assert ElementTree.fromstring(content("svg")).tag.endswith("svg")
    with Image.open(BytesIO(content("png"))) as picture:
        assert picture.size == (1280, 720)
    model = mujoco.MjModel.from_xml_string(content("mjcf").decode())
    assert model.body("robot_4").mocapid[0] >= 0
    model = content("glb")
    size = int.from_bytes(model[12:16], "little")
    names = {node.get("name") for node in json.loads(model[20 : 20 + size])["nodes"]}
    assert names >= {"plank", "robot_1", "robot_4"}


def test_the_video_opens_again(ran, tmp_path):
    """Of the first two actions: five pictures, and a second of the last."""
    start = {**ran[2], "twists": ran[2]["twists"][:2], "poses": ran[2]["poses"][:3]}
    path, told = tmp_path / "trial.mp4", []
    draw("trial", {"line": json.dumps(start)}, path, lambda *now: told.append(now))
    assert told == [(k + 1, 5) for k in range(5)]
    frames, _ = count_frames_and_secs(str(path))
    assert frames == 5 + 20


def test_margins_are_where_they_are_shown(ran):
    """Each is as long as the line that shows it, and the least is the certificate's."""
    rows = ran[1]["margins"]
    assert rows[0]["margin"] == pytest.approx(ran[2]["certificate"]["min_margin"], abs=1e-9)
    assert len(rows) == 2 + 2 * 4
    for row in rows:
        assert math.dist(*row["gap"]) == pytest.approx(abs(row["margin"]), abs=3e-5), row
        assert 0 <= row["time"] <= 0.2 * len(ran[2]["twists"]) + 1e-9
