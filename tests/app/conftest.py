"""The command as a user runs it: a process."""

import os
import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def environment(tmp_path_factory):
    """Compiled programs are shared between the processes of the tests, and with nobody else."""
    return {**os.environ, "DEGGFLOW_CACHE": str(tmp_path_factory.mktemp("cache"))}


@pytest.fixture
def deggflow(environment, tmp_path):
    def run(*arguments, start=False):
        command = [sys.executable, "-m", "deggflow.app.cli", *map(str, arguments)]
        if start:
            return subprocess.Popen(
                command,
                cwd=tmp_path,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    return run
