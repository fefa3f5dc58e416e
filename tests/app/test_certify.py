"""`deggflow tabletop certify` as a user runs it: what holds, what does not, what is not so, what was not asked for."""

import json
import math

import pytest


def conditions(path, *rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


POSES = {"laptop": (-0.3, 0.0, math.pi), "pen_cup": (0.3, 0.0, 0.0)}
# The nearest things are an edge of the table and the laptop's region.
ROOM = 0.7 - 0.3 - 0.155 - 0.07


def scene(satisfied=True, margin=ROOM, reason=None, **poses):
    """A laptop and a pen cup that look away from each other, and what a certificate says of them."""
    placed = {
        name: dict(zip(("x", "y", "theta"), pose, strict=True)) for name, pose in POSES.items()
    }
    for name, changed in poses.items():
        placed[name] = {**placed[name], **changed}
    return {
        "condition": {"objects": list(placed)},
        "objects": [{"name": name, **pose} for name, pose in placed.items()],
        "certificate": {
            "satisfied": satisfied,
            "min_margin": margin,
            "violation": 0.0,
            "draws": 1,
            "reason": reason,
        },
        "seed": 0,
    }


def totals(satisfied, many, wrong):
    return f"{satisfied} of {many} scenes satisfy every requirement; {wrong} lines contain false statements."


OVERLAP = "laptop and pen_cup overlap by 0.0190 m"
INTO = {"x": -0.2}  # the cup: 0.079 - 0.1 + 0.006 + 0.034 m into the laptop
HONEST = scene(False, -0.019, OVERLAP, pen_cup=INTO)
HONEST["certificate"]["violation"] = (0.02 + 0.019) ** 2  # half of it for either object
PROUD = scene(margin=0.5)


def test_good_scenes_are_certified_anew(inside, tmp_path):
    path = conditions(tmp_path / "s.jsonl", scene(), scene(pen_cup={"theta": 0.1}))
    found = inside("tabletop", "certify", path)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.count("now it holds (least margin") == 2
    assert f"line 1: now it holds (least margin {ROOM:.3g} m)" in found.stdout
    assert f"satisfied; least margin {ROOM:.3g}, V 0, 1 draw" in found.stdout
    assert totals(2, 2, 0) in found.stdout
    quiet = inside("tabletop", "certify", path, "--quiet")
    assert (quiet.returncode, quiet.stdout.strip()) == (0, totals(2, 2, 0))


TAMPERED = {
    "a pose moved": (scene(pen_cup=INTO), f"does NOT hold: {OVERLAP}", totals(0, 1, 1)),
    "a flag flipped": (scene(False), "now it holds", totals(1, 1, 1)),
    "a bad one called good": (scene(pen_cup={"x": 0.7}), "over the table's edge", totals(0, 1, 1)),
    "a margin made larger": (PROUD, "the line is wrong", totals(1, 1, 1)),
    "a bad one called bad": (HONEST, f"does NOT hold: {OVERLAP}", totals(0, 1, 0)),
}


@pytest.mark.parametrize("what", TAMPERED)
def test_what_does_not_hold_is_not_certified(inside, tmp_path, what):
    """Behind a good one, alone and with it; whatever its own certificate says."""
    bad, text, alone = TAMPERED[what]
    path = conditions(tmp_path / "s.jsonl", scene(), bad)
    found = inside("tabletop", "certify", path, "--lines", 2)
    assert (found.returncode, found.stderr) == (3, "")
    assert found.stdout.startswith("line 2: ")
    assert text in found.stdout
    assert alone in found.stdout
    both = inside("tabletop", "certify", path)
    assert both.returncode == 3
    assert "line 1: now it holds" in both.stdout
    assert inside("tabletop", "certify", path, "--lines", 1).returncode == 0


def test_scenes_are_compared_with_what_was_asked_for(inside, tmp_path):
    """A larger table, an object less: true of themselves, but not what was asked for."""
    one = scene(pen_cup={"theta": 0.1})
    larger, fewer = scene(), {**one, "condition": {"objects": ["laptop"]}}
    larger["condition"]["table"] = {"width": 1.4, "depth": 0.95}
    fewer["objects"] = fewer["objects"][:1]
    asked = conditions(tmp_path / "asked.jsonl", scene()["condition"], one["condition"])
    path = conditions(tmp_path / "s.jsonl", scene(), one)
    arguments = ("tabletop", "certify", path, "--conditions", asked)
    good = inside(*arguments)
    assert (good.returncode, good.stderr) == (0, "")
    for bad, text in (
        (larger, "line 2: field `condition.table.depth` is 0.95; 0.94 was requested"),
        (fewer, "line 2: field `condition.objects` has 1 entries; 2 were requested"),
    ):
        conditions(path, scene(), bad)
        assert inside("tabletop", "certify", path).returncode == 0
        found = inside(*arguments)
        assert found.returncode == 3
        assert text in found.stdout
        assert totals(2, 2, 1) in found.stdout
    for rows, text in (
        ([scene()], "line 2 is missing: 2 lines were asked for, the file has 1"),
        ([scene(), one, one], "line 3 was not asked for: 2 lines were asked for, the file has 3"),
    ):
        conditions(path, *rows)
        found = inside(*arguments, "--quiet")
        assert found.returncode == 3
        assert found.stdout.splitlines() == [text, totals(len(rows), len(rows), 0)]
    asked.write_text('{"objects": []}')
    assert "asked.jsonl, line 1, field `objects`" in inside(*arguments).stderr


def test_what_no_file_can_show_is_named_in_one_line(inside, tmp_path):
    path = conditions(tmp_path / "s.jsonl", scene())
    named = inside("tabletop", "certify", path).stdout.splitlines()[-2]
    assert named.startswith(
        "Cannot be verified from the file: condition (except with --conditions), "
    )
    assert all(
        name in named
        for name in ("seed", "certificate.draws", "least_opposed_sine", "largest_input_norm")
    )


def test_text_of_a_file_does_not_move_the_cursor(inside, tmp_path):
    path = conditions(tmp_path / "s.jsonl", scene(False, reason="\x1b[31mred\ud800"))
    found = inside("tabletop", "certify", path)
    assert found.returncode == 3
    assert "NOT satisfied: \\x1b[31mred\\ud800;" in found.stdout


def test_what_is_no_scene_is_refused(inside, tmp_path):
    for bad, text in (
        (scene(satisfied=1), "line 2, field `certificate.satisfied`: must be true or false"),
        (scene(pen_cup={"x": None}), "line 2, field `objects[1].x`: must be a number"),
        (scene(pen_cup={"z": 0}), "line 2, field `objects[1].z`: unknown key"),
        ({"objects": ["laptop"]}, "line 2, field `condition`: is missing"),
    ):
        path = conditions(tmp_path / "s.jsonl", scene(), bad)
        found = inside("tabletop", "certify", path)
        assert (found.returncode, found.stdout) == (2, "")
        assert len(found.stderr.splitlines()) == 1
        assert text in found.stderr
    path.write_bytes(b'{"condition": ')
    assert "line 1: not JSON" in inside("tabletop", "certify", path).stderr
    path = conditions(path, scene())
    for line in (0, 2):
        outside = inside("tabletop", "certify", path, "--lines", line)
        assert outside.returncode == 2
        assert f"--lines must lie in [1, 1]; got {line}" in outside.stderr
