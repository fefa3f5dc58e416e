"""`--processes`: real processes, of which one is killed; none outlives the one that started it."""

import os
import signal
import subprocess
import sys

import pytest

from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.consistency import contradictions
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.bridge.options import BridgeGenerate
from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.bridge.processes import BridgeProcesses

NEAR = TrialCondition(  # a few policies from the bridge
    (-0.7, 0.1, 0.05), (1.0, 0.0, 0.0), ((-2.4, 0.36), (-1.9, -0.36), (-1.4, 0.36))
)


@pytest.mark.slow
def test_a_team_of_processes_bridges_the_gap_without_one_that_is_killed(environment, monkeypatch):
    """By zenoh: the killed robot's token vanishes; nobody waits for the deadline, which is longer than any test."""
    pytest.importorskip("zenoh")
    from deggflow.app.team import LocalTeam

    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    rounds = 0

    def kill(process, line):
        nonlocal rounds
        rounds += process == 1 and "round" in line
        if rounds == 20:
            os.kill(team.pids[1], signal.SIGKILL)
            rounds += 1

    options = BridgeGenerate(transport="zenoh", deadline=3600.0)
    with LocalTeam("bridge", BridgeProcesses(), [NEAR], options, on_line=kill) as team:
        [line] = team.results()
        pids = team.pids
    assert line["outcome"] == {"success": True, "reason": None}
    lost = [policy["generation"]["lost"] for policy in line["certificate"]["policies"]]
    assert all([each["agent"] for each in some] == ["robot 2"] for some in lost)
    assert 0 < lost[0][0]["tau"] < 1
    assert all(some[0]["tau"] == 0 for some in lost[1:])
    parse_trial(line)
    assert refutation(line) is None
    assert not contradictions(line)
    assert_ended(pids)


def test_a_process_ends_with_the_one_that_started_it():
    child = "import time; from deggflow.app.parents import end_with_parent; end_with_parent(); print(1, flush=True); time.sleep(600)"
    parent = (
        "import subprocess, sys, time;"
        f"child = subprocess.Popen([sys.executable, '-c', {child!r}], stdin=subprocess.PIPE);"
        "time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"1\n"
    process.kill()
    process.wait()
    assert process.stdout.read() == b""  # the child has it open until it ends
    process.stdout.close()


def assert_ended(pids):
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


FREEZES = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
FAILS = "import sys; sys.exit('deggflow: agents [0] are silent')"
TALKS = "import time; print('{\"round\": {}}', flush=True); time.sleep(600)"


@pytest.fixture
def children(monkeypatch):
    """Teams whose processes run these programs; pids of all that were started."""
    from deggflow.app.team import LocalTeam

    programs, pids, start = [], [], LocalTeam._start
    monkeypatch.setattr(
        LocalTeam, "_command", lambda self, number, first: [sys.executable, "-c", programs[number]]
    )

    def started(self, number, first):
        start(self, number, first)
        pids.append(self._children[number].popen.pid)

    monkeypatch.setattr(LocalTeam, "_start", started)
    return programs, pids


def test_ctrl_c_ends_all_processes_frozen_ones_too(inside, children, monkeypatch):
    from deggflow.app.team import RoundView

    def interrupt(self, process, line):
        raise KeyboardInterrupt

    monkeypatch.setattr(RoundView, "take", interrupt)
    programs, pids = children
    programs += [TALKS, FREEZES]
    done = inside("tabletop", "generate", "--size", "2", "--processes")
    assert done.returncode == 130
    assert len(pids) == 2
    assert_ended(pids)


def test_a_team_of_which_only_frozen_processes_are_left_ends(children):
    from deggflow.app.team import LocalTeam
    from deggflow.runtime import TeamError
    from deggflow.tasks.tabletop.condition import SceneCondition
    from deggflow.tasks.tabletop.options import TabletopGenerate
    from deggflow.tasks.tabletop.processes import TabletopProcesses

    programs, pids = children
    programs += [FREEZES, FAILS]
    scene, options = SceneCondition(("laptop", "desk_lamp")), TabletopGenerate(processes=0)
    with LocalTeam("tabletop", TabletopProcesses(), [scene], options) as team:
        team._silence = 0.2
        with pytest.raises(TeamError, match=r"number 1 ended; it says: agents \[0\] are silent"):
            list(team.results())
    assert_ended(pids)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["generate", "--size", "3", "--processes", "--guidance", "none"], "--processes goes with"),
        (["generate", "--size", "3", "--metrics", "m"], "--metrics goes with --processes"),
        (["generate", "--size", "40", "--processes"], "needs a number, such as --processes 8"),
        (["generate", "--size", "4", "--processes", "2"], "--processes with a number takes large scenes"),
        (["generate", "--size", "14", "--processes", "15"], "must give each process 1 to 1000 of the 14 objects"),
        (["generate", "--size", "40", "--processes", "1"], "--processes must lie in [2, 64]; got 1"),
        (["generate", "--size", "40", "--processes", "2", "--guidance-phase", "during"], "goes with --guidance-phase after"),
        (["generate", "--size", "40", "--processes", "2", "--requirements", "balanced"], "without a balance"),
    ],
)  # fmt: skip
def test_bad_arguments_are_one_line(inside, arguments, hint):
    done = inside("tabletop", *arguments)
    assert done.returncode == 2
    assert hint in done.stderr


@pytest.mark.parametrize(
    ("processes", "hint"),
    [(["2"], "--addresses must be those of all 2 processes; got 3"), ([], "--processes without a number")],
)  # fmt: skip
def test_a_part_of_a_large_scene_is_told_how_many_there_are(inside, processes, hint):
    place = ["--number", "0", "--addresses", "a:1", "b:2", "c:3"]
    done = inside("run", "agent", "tabletop", "--size", "40", "--processes", *processes, *place)
    assert done.returncode == 2
    assert hint in done.stderr


def test_children_are_told_how_many_share_a_scene():
    from deggflow.app.team import LocalTeam
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.options import TabletopGenerate
    from deggflow.tasks.tabletop.processes import TabletopProcesses

    scenes, options = random_conditions(14, 1, "changed", 0), TabletopGenerate(processes=2)
    with LocalTeam("tabletop", TabletopProcesses(), scenes, options) as team:
        words = team._command(1, 0)
    assert words[words.index("--processes") + 1] == "2"
    assert len(words[words.index("--addresses") + 1 : words.index("--conditions")]) == 2


def test_addresses_are_those_of_all(inside):
    done = inside("run", "agent", "bridge", "--size", "2", "--number", "0", "--addresses", "a:1", "b:2")  # fmt: skip
    assert done.returncode == 2
    assert "--addresses must be those of all 3 robots and the world; got 2" in done.stderr
