"""Without its extra, the studio says in one line what to install."""

import sys

import pytest


@pytest.mark.parametrize("package", ["starlette", "uvicorn", "websockets"])
def test_a_missing_extra_is_told_in_one_line(inside, monkeypatch, package):
    for present in ("starlette", "uvicorn", "websockets"):
        monkeypatch.setitem(sys.modules, present, sys if present != package else None)
    ended = inside("studio", "--no-browser")
    assert ended.returncode == 2
    assert ended.stderr == (
        f"deggflow: the studio needs the package {package}: pip install 'deggflow[studio]'\n"
    )


def test_the_command_is_listed_without_its_extra(deggflow):
    assert "studio" in deggflow("--help").stdout
