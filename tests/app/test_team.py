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
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


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


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["generate", "--size", "3", "--processes", "--guidance", "none"], "--processes goes with"),
        (["generate", "--size", "3", "--metrics", "m"], "--metrics goes with --processes"),
        (["generate", "--size", "40", "--processes"], "needs a number, such as --processes 8"),
        (["generate", "--size", "4", "--processes", "2"], "--processes with a number takes large scenes"),
        (["generate", "--size", "40", "--processes", "1"], "--processes must lie in [2, 64]; got 1"),
        (["generate", "--size", "40", "--processes", "2", "--guidance-phase", "during"], "goes with --guidance-phase after"),
        (["generate", "--size", "40", "--processes", "2", "--requirements", "balanced"], "without a balance"),
    ],
)  # fmt: skip
def test_bad_arguments_are_one_line(inside, arguments, hint):
    done = inside("tabletop", *arguments)
    assert done.returncode == 2
    assert hint in done.stderr


def test_addresses_are_those_of_all(inside):
    done = inside("run", "agent", "bridge", "--size", "2", "--number", "0", "--addresses", "a:1", "b:2")  # fmt: skip
    assert done.returncode == 2
    assert "--addresses must be those of all 3 robots and the world; got 2" in done.stderr
