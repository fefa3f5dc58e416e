"""`deggflow studio` as a user starts it."""

import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest


@pytest.fixture
def started(environment):
    """A studio at a free port, and its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "deggflow.app.start", "studio", "--no-browser", "--port", "0"],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    yield process, process.stdout.readline().strip()
    process.kill()
    process.communicate()


def test_the_address_that_it_prints_opens_the_page(started):
    process, address = started
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", address)
    with urllib.request.urlopen(address, timeout=600) as page:
        assert b"deggflow studio" in page.read()
    with pytest.raises(urllib.error.HTTPError, match="404") as refused:
        urllib.request.urlopen(address[:-2], timeout=600)
    refused.value.close()
    process.send_signal(signal.SIGINT)
    assert process.wait(600) == 0
    assert process.stderr.read().splitlines()[-1] == "deggflow: the studio has stopped"


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--host", "0.0.0.0"], "--host must be one address of this machine"),
        (["--host", "example.org"], "--host must be an IP address or localhost"),
        (["--weights", "none.safetensors"], "none.safetensors: there is no such file"),
        (["--port", "70000"], r"--port must lie in \[0, 65535\]"),
        (["--port", "1", "--host", "192.0.2.1"], "can't listen at 192.0.2.1, port 1"),
    ],
)
def test_bad_options_are_told_in_one_line(inside, arguments, error):
    ended = inside("studio", "--no-browser", *arguments)
    assert ended.returncode == 2
    assert re.match(rf"deggflow: {error}", ended.stderr)
    assert ended.stderr.count("\n") == 1


def test_a_bad_token_is_told(inside, monkeypatch):
    monkeypatch.setenv("DEGGFLOW_STUDIO_TOKEN", "short/")
    ended = inside("studio", "--no-browser")
    assert (ended.returncode, ended.stderr) == (
        2,
        "deggflow: DEGGFLOW_STUDIO_TOKEN must have at least 16 letters, digits, - or _\n",
    )
