"""Real processes: one is killed and one frozen in the middle, and the others finish."""

import json
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from deggflow.runtime import Timing, UdpTransport, free_addresses

SCRIPT = Path(__file__).with_name("one_agent.py")


class Process:
    """A started agent, and what it has printed."""

    def __init__(self, kind, number, deadline, addresses):
        command = [sys.executable, str(SCRIPT), kind, str(number), "3", str(deadline), *addresses]
        self.popen = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.lines, self.ended = [], False
        self.news = threading.Condition()
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.popen.stdout:
            with self.news:
                self.lines.append(json.loads(line))
                self.news.notify_all()
        with self.news:
            self.ended = True
            self.news.notify_all()

    def wait_for(self, condition):
        """Until a line meets it, or the process ends."""
        with self.news:
            self.news.wait_for(lambda: any(condition(line) for line in self.lines) or self.ended)

    def wait_for_round(self, number):
        self.wait_for(lambda line: line.get("round", 0) >= number)

    def end(self):
        """Its exit code and the last line."""
        code = self.popen.wait()
        with self.news:
            self.news.wait_for(lambda: code < 0 or "round" not in self.lines[-1])
        return code, self.lines[-1]


@contextmanager
def processes(kind, agents, deadline):
    addresses = [f"{host}:{port}" for host, port in free_addresses(agents)]
    if kind == "zenoh":
        addresses = [f"tcp/{address}" for address in addresses]
    team = [Process(kind, k, deadline, addresses) for k in range(agents)]
    try:
        yield team
    finally:
        for one in team:
            if one.popen.poll() is None:
                one.popen.kill()
            one.popen.wait()
            one.popen.stdout.close()


def assert_same_sample(ends, lost):
    for code, line in ends:
        assert code == 0, line
        assert line == ends[0][1]
    line = ends[0][1]
    assert line["satisfied"]
    assert line["lost"] == [f"agent {k}" for k in lost]
    z = np.array(line["z"])
    apart = np.linalg.norm(z[:, None] - z[None], axis=-1) + 9 * np.eye(len(z))
    assert apart.min() >= 0.5


@pytest.mark.slow
def test_processes_go_on_without_one_that_is_killed_and_one_that_is_frozen():
    """By datagrams: silence is noticed after the deadline. The frozen one wakes up to find itself left behind."""
    with processes("udp", 5, 20.0) as team:
        team[0].wait_for_round(10)
        team[2].popen.send_signal(signal.SIGKILL)
        team[4].popen.send_signal(signal.SIGSTOP)
        team[0].wait_for(lambda line: line.get("members") == 3)
        # If the others had ended, it would miss them after the deadline.
        team[4].popen.send_signal(signal.SIGCONT)
        assert_same_sample([team[k].end() for k in (0, 1, 3)], lost=[2, 4])
        code, line = team[4].end()
    assert code == 3
    assert line["error"].startswith(("SuspectedError", "TooManyLostError"))


@pytest.mark.slow
def test_by_zenoh_a_killed_process_is_missed_at_once():
    """Its token vanishes; nobody waits for the deadline, which is longer than any test."""
    pytest.importorskip("zenoh")
    with processes("zenoh", 4, 3600.0) as team:
        team[0].wait_for_round(10)
        team[1].popen.send_signal(signal.SIGKILL)
        assert_same_sample([team[k].end() for k in (0, 2, 3)], lost=[1])


def test_datagrams_of_strangers_are_not_heard():
    addresses = free_addresses(2)
    one, other = (UdpTransport(k, addresses) for k in range(2))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"nonsense", addresses[0])
        other.broadcast(b"hello")
        assert one.receive(60.0) == b"hello"
        assert one.receive(0.0) is None
    assert one.gone() == frozenset()
    with pytest.raises(ValueError, match="`message` must have at most 65000 bytes; got 70000"):
        one.broadcast(bytes(70_000))
    one.close()
    other.close()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"deadline": 0.0}, "`deadline` must be positive, in seconds; got 0.0"),
        ({"tick": 2.0}, "`tick` must be at most a third of `deadline`"),
    ],
)
def test_times_are_checked(change, match):
    with pytest.raises(ValueError, match=match):
        Timing(**change)
