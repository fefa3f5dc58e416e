"""`deggflow bridge` as a user runs it: processes, exit codes, files."""

import json
import re
import shutil
import signal
import time
from pathlib import Path

import pytest

from deggflow import task
from deggflow.app.remake import remake
from deggflow.tasks.bridge.formats import read_trials
from deggflow.tasks.bridge.options import DemonstrationRecipe
from deggflow.tasks.bridge.oracle import refutation
from deggflow.train import TrainingConfig

GOAL = {"x": -0.2, "y": 0.0, "theta": 0.0}
CONTACTS = [[-2.4, 0.36], [-2.4, -0.36], [-1.0, 0.36]]


def start(x, theta=0.0, contacts=CONTACTS):
    return {"plank": {"x": x, "y": 0.0, "theta": theta}, "goal": GOAL, "contacts": contacts}


# One has a little way to go, one is there, in one a robot stands in the gap.
CONDITIONS = [start(-1.2, 0.1), start(-0.25), start(-1.0, contacts=[[-2.4, 0.36], [1.5, -0.36]])]
GENERATE = ("bridge", "generate", "--conditions", "wanted.jsonl", "--seed", 5)


def write(path, rows):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))


@pytest.fixture(scope="session")
def generated(tmp_path_factory, run_deggflow):
    """The folder of a finished run, and what the command said."""
    folder = tmp_path_factory.mktemp("bridge")
    write(folder / "wanted.jsonl", CONDITIONS)
    return folder, run_deggflow(folder, *GENERATE, "--out", "trials.jsonl")


@pytest.fixture
def trials(generated, tmp_path):
    """The same in the test's own folder."""
    for path in generated[0].iterdir():
        shutil.copy(path, tmp_path)
    return tmp_path / "trials.jsonl"


def test_help_names_every_command(deggflow):
    assert "bridge" in deggflow("--help").stdout
    text = deggflow("bridge", "--help").stdout
    for command in ("data", "train", "generate", "certify", "evaluate", "render"):
        assert command in text


def test_trials_of_a_file_are_certified_and_none_is_refuted(generated, trials):
    said = generated[1]
    assert said.returncode == 3, said.stderr
    assert "2 of 3 trials bridge the gap. They are in trials.jsonl." in said.stderr
    lines = [json.loads(line) for line in trials.read_text().splitlines()]
    assert [line["condition"] for line in lines] == CONDITIONS  # as given, in order
    assert [refutation(line) for line in lines] == [None, None, None]
    again = [json.loads(json.dumps(trial.to_json())) for trial in read_trials(trials)]
    assert again == lines
    assert {line["seed"] for line in lines} == {5}
    moved, there, broken = lines
    assert moved["certificate"]["satisfied"]
    assert len(moved["certificate"]["policies"]) == -(-len(moved["twists"]) // 4)
    assert there["outcome"] == {"success": True, "reason": None}
    assert broken["outcome"] == {
        "success": False,
        "reason": "at the start robot 2 enters the gap",
    }
    assert there["twists"] == broken["twists"] == []


def test_what_a_kill_leaves_is_completed_to_the_same_bytes(trials, deggflow, inside, tmp_path):
    whole, out = trials.read_bytes(), tmp_path / "killed.jsonl"
    process = deggflow(*GENERATE, "--out", out, start=True)
    while process.poll() is None and not out.exists():
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert whole.startswith(out.read_bytes())
    assert deggflow(*GENERATE, "--out", out).returncode == 3
    assert out.read_bytes() == whole
    with out.open("r+b") as file:  # as a kill in the middle of a write would leave it
        file.truncate(len(whole) * 3 // 5)
    assert inside(*GENERATE, "--out", out).returncode == 3
    assert out.read_bytes() == whole
    other = inside(*GENERATE, "--max-draws", 3, "--out", out)
    assert other.returncode == 2
    assert "begun with max_draws" in other.stderr


def edited(value, path, new):
    out = json.loads(json.dumps(value))
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    place[last] = new
    return out


def totals(bridged, refuted, *rows):
    """What is said of some lines at the end; speeds of contact points in complex numbers."""
    moving = [
        abs(complex(vx, vy) + 1j * turn * complex(*r))
        for row in rows
        for vx, vy, turn in row["twists"]
        for r in row["condition"]["contacts"]
    ]
    return (
        f"{bridged} of {len(rows)} trials bridge the gap; the replay refutes what {refuted} say; "
        f"the fastest contact point moved at {max(moving, default=0.0):.3f} m/s."
    )


def test_trials_are_certified_anew(trials, inside):
    """All that is said is true, but in one a robot stands in the gap."""
    rows = [json.loads(line) for line in trials.read_text().splitlines()]
    found = inside("bridge", "certify", trials)
    assert found.returncode == 3
    assert found.stderr == ""
    assert totals(2, 0, *rows) in found.stdout
    assert found.stdout.count("the replay agrees") == 3
    assert "NOT satisfied: at the start robot 2 enters the gap" in found.stdout
    good = inside("bridge", "certify", trials, "--lines", 1, 2)
    assert good.returncode == 0
    assert totals(2, 0, *rows[:2]) in good.stdout
    assert "line 3" not in good.stdout
    # A line for each policy, with the names of its columns above.
    for policy in rows[0]["certificate"]["policies"]:
        assert f"{policy['q_task']:.4f}" in good.stdout
    assert all(name in good.stdout for name in ("q_task", "bound", "q_safe", "hypotheses hold"))
    quiet = inside("bridge", "certify", trials, "--quiet")
    assert (quiet.returncode, quiet.stdout.strip()) == (3, totals(2, 0, *rows))


def test_what_was_tampered_with_is_not_certified(trials, inside):
    rows = [json.loads(line) for line in trials.read_text().splitlines()]
    moved, _, broken = rows
    poses = moved["poses"]
    for where, row, path, new, text in (
        (1, moved, ("poses", 3, 1), poses[3][1] + 0.01, "pose 3 is not where the twists lead"),
        (1, moved, ("twists", 0), [0.0, 0.0, 0.0], "pose 1 is not where the twists lead"),
        (1, moved, ("certificate", "min_margin"), 2.0, "the least margin is"),
        (1, moved, ("certificate", "policies", 0, "accepted"), False, "misses a bound"),
        (3, broken, ("certificate", "satisfied"), True, "a trial that failed is certified"),
    ):
        bad = edited(row, path, new)
        write(trials, [*rows[: where - 1], bad, *rows[where:]])
        found = inside("bridge", "certify", trials, "--lines", where)
        assert found.returncode == 3
        assert f"line {where}: the replay finds that " in found.stdout
        assert text in found.stdout
        assert totals(0, 1, bad) in found.stdout
        whole = inside("bridge", "certify", trials, "--quiet")
        assert whole.returncode == 3
        others = [each for each in rows if each is not row]
        assert whole.stdout.strip() == totals(1 if where == 1 else 2, 1, bad, *others)


def test_what_contradicts_itself_is_not_certified(trials, inside):
    moved, *others = [json.loads(line) for line in trials.read_text().splitlines()]
    policies = moved["certificate"]["policies"]
    for changes, field in (
        ({"reason": "because"}, "certificate.reason"),
        ({"satisfied": False}, "certificate.satisfied"),
        ({"violation": 5}, "certificate.violation"),
        ({"draws": 7}, "certificate.draws"),
        ({"policies": []}, "certificate.policies"),
        ({"policies": policies[1:]}, "certificate.policies"),
        (
            {"policies": [{**policies[0], "q_task": policies[0]["q_task"] - 1}, *policies[1:]]},
            "certificate.policies[0].q_task",
        ),
    ):
        bad = {**moved, "certificate": {**moved["certificate"], **changes}}
        write(trials, [bad, *others])
        found = inside("bridge", "certify", trials, "--lines", 1)
        assert found.returncode == 3
        assert f"line 1: field `{field}` " in found.stdout
        assert totals(1, 1, bad) in found.stdout


def test_trials_are_compared_with_what_was_asked_for(trials, inside, tmp_path):
    """A goal that was moved, a trial that is missing: nothing in the file itself shows it."""
    first, there, _ = [json.loads(line) for line in trials.read_text().splitlines()]
    write(trials, [first, there])
    asked = tmp_path / "asked.jsonl"
    arguments = ("bridge", "certify", trials, "--conditions", asked)
    write(asked, CONDITIONS[:2])
    good = inside(*arguments)
    assert good.returncode == 0
    named = good.stdout.splitlines()[-2]
    assert named.startswith(
        "Cannot be verified from the file: condition.goal (except with --conditions)"
    )
    write(asked, [{**CONDITIONS[0], "goal": {**GOAL, "x": -0.3}}, CONDITIONS[1]])
    found = inside(*arguments)
    assert found.returncode == 3
    assert "line 1: field `condition.goal.x` is -0.2; -0.3 was requested" in found.stdout
    assert totals(2, 1, first, there) in found.stdout
    write(asked, CONDITIONS)
    found = inside(*arguments)
    assert found.returncode == 3
    assert "line 3 is missing: 3 lines were asked for, the file has 2" in found.stdout


def test_what_is_no_trial_is_refused(trials, inside):
    rows = [json.loads(line) for line in trials.read_text().splitlines()]
    for path, new, text in (
        (("certificate", "satisfied"), 1, "field `certificate.satisfied`: must be true or false"),
        (("poses", 0), [0, 0, 0], "field `poses[0]`: must be the condition's plank pose"),
        (("certificate", "speed_limit"), -1, "field `certificate.speed_limit`: must lie in"),
        (
            ("certificate", "policies", 0, "generation", "requirements", 1, "value"),
            "low",
            "field `certificate.policies[0].generation.requirements[1].value`: must be a number",
        ),
    ):
        write(trials, [rows[1], edited(rows[0], path, new)])
        found = inside("bridge", "certify", trials)
        assert (found.returncode, found.stdout) == (2, "")
        assert len(found.stderr.splitlines()) == 1
        assert f"trials.jsonl, line 2, {text}" in found.stderr
    write(trials, rows)
    outside = inside("bridge", "certify", trials, "--lines", 4)
    assert outside.returncode == 2
    assert "--lines must lie in [1, 3]; got 4" in outside.stderr


def test_a_speed_limit_that_is_too_tight_stops_the_team(inside, tmp_path):
    write(tmp_path / "wanted.jsonl", CONDITIONS[:1])
    limited = ("--speed-limit", 0.01, "--max-draws", 2, "--out", "slow.jsonl")
    found = inside(*GENERATE, *limited)
    assert found.returncode == 3, found.stderr
    assert "0 of 1 trial bridges the gap" in found.stderr
    row = json.loads((tmp_path / "slow.jsonl").read_text())
    assert row["certificate"]["speed_limit"] == 0.01
    assert not row["certificate"]["satisfied"]
    *done, last = row["certificate"]["policies"]
    assert all(policy["speed"] <= 0.01 for policy in done)
    assert not last["accepted"]
    assert "blocked at policy" in row["outcome"]["reason"]
    assert last["speed"] > 0.01
    said = re.search(r"robot ([1-3]) would move at ([0-9.]+) m/s", row["outcome"]["reason"])
    assert float(said[2]) == pytest.approx(last["speed"], abs=5e-4)
    assert refutation(row) is None
    assert inside("bridge", "certify", "slow.jsonl").returncode == 3
    other = inside(*GENERATE, "--speed-limit", 0.02, *limited[2:])
    assert other.returncode == 2
    assert "begun with speed_limit = 0.01, not 0.02" in other.stderr


def test_the_nominal_field_alone_never_fails_the_command(trials, inside):
    found = inside(*GENERATE, "--guidance", "none")
    assert found.returncode == 0, found.stderr
    rows = [json.loads(line) for line in found.stdout.splitlines()]
    assert not rows[2]["outcome"]["success"]
    assert {row["certificate"]["draws"] for row in rows} == {1}
    assert re.search(r"[12] of 3 trials bridge the gap\.", found.stderr)


BAD = {
    "truncated": (b'{"plank": {"x": 0', "line 1: not JSON"),
    "unknown key": (json.dumps({**start(-3.2), "speed": 1}).encode(), "field `speed`: unknown"),
    "overlap": (
        json.dumps(start(-3.2, contacts=[[0, 0.36], [0.1, 0.36]])).encode(),
        "field `contacts[1]`: robots 1 and 2 overlap",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_exit_with_2_in_one_line_and_touch_nothing(inside, tmp_path, name):
    content, hint = BAD[name]
    (tmp_path / "bad.jsonl").write_bytes(content)
    found = inside("bridge", "generate", "--conditions", "bad.jsonl", "--out", "out.jsonl")
    assert found.returncode == 2
    assert found.stdout == ""
    assert len(found.stderr.splitlines()) == 1
    assert "bad.jsonl, line 1" in found.stderr
    assert hint in found.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bad.jsonl"]


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("generate",), "--conditions FILE or --size"),
        (("generate", "--size", "9"), "--size must lie in [2, 8]; got 9"),
        (("generate", "--size", "4", "--weights", "no.safetensors"), "--weights can't be used"),
        (("train", "--data", "nowhere", "--out", "run"), "nowhere/training.jsonl: can't be read"),
        (("evaluate", "--sizes", "1"), "--sizes must"),
        (("evaluate", "--figure", "ways.png"), "--figure goes with --modes"),
        (("render", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify",), "trials"),
        *(
            (
                ("generate", "--size", "4", "--speed-limit", speed),
                f"--speed-limit must lie in [0.01, 10] m/s; got {float(speed)}",
            )
            for speed in ("0", "0.0099", "-0.3", "10.1", "inf", "nan")
        ),
        (("generate", "--size", "4", "--speed-limit", "slow"), "slow"),
        (
            ("generate", "--size", "4", "--speed-limit", "0.3", "--guidance", "none"),
            "--speed-limit goes with --guidance degg",
        ),
    ],
)
def test_bad_arguments_exit_with_2(inside, tmp_path, arguments, hint):
    found = inside("bridge", *arguments)
    assert found.returncode == 2, found.stderr
    assert hint in found.stderr
    assert not any(tmp_path.iterdir())


def test_every_trial_is_drawn_with_all_there_is(trials, inside):
    """Twin, process, curves and video of the one that moved; what there is of the others."""
    render = ("bridge", "render", "trials.jsonl", "--out", "p")
    found = inside(
        *(*render, "--lines", 1, "--nominal", "--process", "--curves", "--renderer", "matplotlib")
    )
    assert found.returncode == 0, found.stderr
    names = [f"p/trial_0001{part}.png" for part in ("", "_process", "_q_task", "_q_safe")]
    assert found.stdout.split() == names
    assert all((trials.parent / name).stat().st_size > 1000 for name in names)
    found = inside(*(*render, "--lines", 2, 3, "--curves", "--video", "--renderer", "matplotlib"))
    assert found.returncode == 0, found.stderr
    assert "Trial 2 has no policies" in found.stderr
    assert [Path(line).name for line in found.stdout.split()] == [
        f"trial_000{line}{ending}" for line in (2, 3) for ending in (".png", ".mp4")
    ]


def test_a_trial_that_was_not_made_from_its_seed_has_no_twin(trials, inside):
    rows = [json.loads(line) for line in trials.read_text().splitlines()]
    write(trials.parent / "other.jsonl", [{**rows[0], "seed": 6}])
    refused = inside("bridge", "render", "other.jsonl", "--nominal")
    assert refused.returncode == 2
    assert "other.jsonl, line 1: can't be generated again" in refused.stderr


def test_evaluation_prints_its_tables_and_keeps_its_rows(inside, tmp_path):
    arguments = ("bridge", "evaluate", "--trials", 1, "--sizes", 2, "--out", "rows.jsonl")
    found = inside(*arguments)
    assert found.returncode in (0, 3), found.stderr
    (row,) = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert (row["trials"], row["refuted"]) == (1, [])
    assert row["guided"] + len(row["blocked"]) == 1
    assert found.returncode == 3 * (1 - row["guided"])
    assert row["policies"]["guided"]["generated"] > 0
    for heading in ("success", "failures of nominal trials", "below their bounds"):
        assert heading in found.stdout
    assert inside(*arguments).stdout == found.stdout


def test_sides_are_compared_with_the_demonstrations(inside, tmp_path):
    found = inside("bridge", "evaluate", "--modes", 1, "--figure", "ways.png")
    assert found.returncode == 0, found.stderr
    for source in ("demonstrations", "nominal", "guided"):
        assert source in found.stdout
    assert (tmp_path / "ways.png").stat().st_size > 1000


def test_the_cards_commands_are_what_a_user_types(inside, monkeypatch, tmp_path):
    """Data are made; the training itself is too long for a test, so what it is asked for is looked at."""
    asked = []

    def train_field(model, data, out, config, architecture, show, *, commands, devices):
        assert (model.task, architecture, devices) == ("bridge", {}, None)
        out.mkdir()
        for name in ("field.safetensors", "field.json"):
            (out / name).touch()
        (out / "curves.csv").write_text("step,training,validation\n500,1.0,2.0\n")
        asked.append((data, out, config))

    monkeypatch.setattr(task, "train_field", train_field, raising=False)
    config = TrainingConfig(steps=1500, batch=32, learning_rate=2e-3, seed=4)
    recipe = {"sizes": [4, 5, 6], "training": 2, "validation": 1, "seed": 3}
    for command in remake("bridge", DemonstrationRecipe, {})(recipe, config, [config.steps]):
        name, *arguments = command.split()
        assert name == "deggflow"
        found = inside(*arguments)
        assert found.returncode == 0, found.stderr
    files = (Path("data/training.jsonl"), Path("data/validation.jsonl"))
    assert asked == [(files, Path("run"), config)]
    assert json.loads((tmp_path / "data/training.jsonl.run.json").read_text()) == recipe
    assert len((tmp_path / "data/training.jsonl").read_text().splitlines()) == 6
    assert (tmp_path / "run/curves.png").stat().st_size > 1000
