"""The command line as a user runs it: processes, exit codes, files."""

import json
import shutil
import subprocess
import sys

import pytest
from rich.console import Console


def test_help_reads_well_and_names_every_command(deggflow):
    text = deggflow("--help").stdout
    assert "tabletop" in text
    assert "demo" in text
    text = deggflow("tabletop", "--help").stdout
    for command in ("data", "train", "generate", "certify", "evaluate", "render"):
        assert command in text


def test_results_go_to_stdout_and_repeat(deggflow, inside):
    arguments = ("tabletop", "generate", "--size", 5, "--count", 3, "--seed", 1)
    first, second = deggflow(*arguments), inside(*arguments)
    assert first.returncode == 0
    assert first.stdout == second.stdout
    assert len([json.loads(line) for line in first.stdout.splitlines()]) == 3


def test_damaged_compiled_programs_are_told_once_and_renewed(environment, tmp_path):
    cache = tmp_path / "cache"
    environment = {**environment, "DEGGFLOW_CACHE": str(cache)}

    def generate():
        command = [
            sys.executable,
            "-m",
            "deggflow.app.start",
            "tabletop",
            "generate",
            "--size",
            "2",
            "--guidance",
            "none",
        ]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    first = generate()
    programs = list((cache / "xla").iterdir())
    assert programs
    for path in programs:
        path.write_bytes(path.read_bytes()[:100])
    second, third = generate(), generate()
    assert first.stdout == second.stdout == third.stdout
    assert second.stderr.count("were damaged; they are compiled again") == 1
    assert "Warning" not in second.stderr
    assert third.stderr == first.stderr


def test_an_argument_with_a_nul_character_is_bad_input(inside):
    assert inside("tabletop", "certify", "a\0b").stderr == (
        "deggflow: an argument must not contain a NUL character\n"
    )


BAD = {
    "truncated": (b'{"objects": ["laptop"', "not JSON"),
    "unknown object": (b'{"objects": ["sofa"]}', "objects[0]"),
    "duplicate object": (b'{"objects": ["laptop", "laptop"]}', "objects[1]"),
    "NaN": (b'{"objects": ["laptop"], "table": {"width": NaN, "depth": 1}}', "NaN"),
    "negative scale": (
        b'{"objects": ["laptop"], "requirements": {"laptop": {"radius_scale": -1}}}',
        "requirements.laptop.radius_scale",
    ),
    "wrong type": (b'{"objects": "laptop"}', "objects"),
    "empty": (b"", "empty"),
    "huge": (b'{"objects": ["' + b"x" * 5_000_000 + b'"]}', "longer than"),
    "binary": (bytes(range(256)), "line 1"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_exit_with_2_in_one_line_and_touch_nothing(inside, tmp_path, name):
    content, hint = BAD[name]
    path, out = tmp_path / "bad.jsonl", tmp_path / "out.jsonl"
    path.write_bytes(content)
    before = {p.name for p in tmp_path.iterdir()}
    found = inside("tabletop", "generate", "--conditions", path, "--out", out)
    assert found.returncode == 2
    assert found.stdout == ""
    assert len(found.stderr.splitlines()) == 1
    assert "bad.jsonl, line 1" in found.stderr
    assert hint in found.stderr
    assert {p.name for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("generate",), "--conditions FILE or --size"),
        (("generate", "--size", "10001"), "--size must lie in [1, 10000]; got 10001"),
        (("generate", "--size", "4", "--count", "0"), "--count must"),
        (("generate", "--size", "4", "--max-draws", "0"), "--max-draws must"),
        (("generate", "--size", "4", "--seed", "-1"), "--seed must"),
        (
            ("generate", "--size", "4", "--evaluations", "0"),
            "--evaluations must lie in [1, 100]; got 0",
        ),
        (("generate", "--size", "4", "--guidance-phase", "later"), "guidance-phase"),
        (("evaluate", "--evaluations", "101"), "--evaluations must lie in [1, 100]; got 101"),
        (("generate", "--conditions", "no.jsonl"), "no.jsonl: can't be read: No such file"),
        (("generate", "--size", "four"), "four"),
        (("generate", "--size", "4", "--guidance", "magic"), "magic"),
        (("generate", "--size", "4", "--weights", "no.safetensors"), "--weights can't be used"),
        (("train", "--data", "nowhere", "--out", "run"), "nowhere/training.jsonl: can't be read"),
        (("train", "--data", ".", "--out", "run", "--steps", "7"), "`steps` must"),
        (("generate", "--size", "4", "--requirements", "magic"), "magic"),
        (("render", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify", "no.jsonl"), "no.jsonl: can't be read"),
        (("certify",), "scenes"),
        (("evaluate", "--sizes", "0"), "--sizes must"),
        (("evaluate", "--seed", "-1"), "--seed must"),
        (("data", "--out", "d", "--seed", "2000000000"), "--seed must"),
    ],
)
def test_bad_arguments_exit_with_2(inside, tmp_path, arguments, hint):
    found = inside("tabletop", *arguments)
    assert found.returncode == 2, found.stderr
    assert hint in found.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("data", "--out", "o", "--training", 4, "--validation", 2),
        ("generate", "--size", 4, "--guidance", "none", "--out", "o/a.jsonl"),
    ],
)
def test_a_folder_removed_as_the_last_line_is_printed_is_noticed(
    inside, tmp_path, monkeypatch, arguments
):
    """Between the last look at the files and the line that names them, anything may happen."""
    printed = Console.print

    def remove(console, *objects, **settings):
        if " in o" in str(objects):
            shutil.rmtree(tmp_path / "o")
        printed(console, *objects, **settings)

    monkeypatch.setattr(Console, "print", remove)
    ended = inside("tabletop", *arguments)
    assert ended.returncode == 2
    assert "was removed while it was being written" in ended.stderr
