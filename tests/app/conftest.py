"""The command as a user runs it: a process, or, where that takes too long, a call of its main function."""

import os
import subprocess
import sys
from functools import partial
from types import SimpleNamespace

import jax
import pytest

from deggflow.app.cli import main
from deggflow.tasks.tabletop.field import build_field
from deggflow.weights import save_weights


@pytest.fixture(scope="session")
def environment(compiled_programs):
    """Compiled programs are shared between the processes of the tests, and with nobody else."""
    return {**os.environ, "DEGGFLOW_CACHE": str(compiled_programs)}


@pytest.fixture(scope="session")
def small_weights(tmp_path_factory):
    """A small untrained field of the tabletop, for what holds of any field."""
    path = tmp_path_factory.mktemp("weights") / "field.safetensors"
    sizes = {"width": 8, "rounds": 1, "head_width": 8}
    save_weights(path, build_field(jax.random.key(0), **sizes), {"architecture": sizes})
    return path


@pytest.fixture(scope="session")
def run_deggflow(environment):
    """Runs the command in a folder, or starts it there."""

    def run(folder, *arguments, start=False):
        command = [sys.executable, "-m", "deggflow.app.start", *map(str, arguments)]
        if start:
            return subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        return subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )

    return run


@pytest.fixture
def deggflow(run_deggflow, tmp_path):
    """Runs the command in the test's own folder."""
    return partial(run_deggflow, tmp_path)


@pytest.fixture
def inside(environment, tmp_path, monkeypatch, capsys):
    """Runs the command within the tests' own process, which compiles each program once."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DEGGFLOW_CACHE", environment["DEGGFLOW_CACHE"])

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(list(map(str, arguments)))
        said = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=said.out, stderr=said.err)

    return run
