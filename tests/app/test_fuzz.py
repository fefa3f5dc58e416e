"""Every file that the program reads, mutated: read, or refused in one line."""

import json
import random

import fuzz
import pytest

from deggflow.jsonl import InputError

BOUND = 40  # mutations of a kind; `python benchmarks/fuzz.py` makes 10,000 in all


@pytest.mark.parametrize("task", fuzz.MAKERS)
def test_mutated_files_are_read_or_refused_in_one_line(tmp_path, monkeypatch, task):
    monkeypatch.setattr(fuzz, "LIMIT", 600.0)  # s; what hangs is found on slow machines, too
    refused = 0
    for kind in fuzz.MAKERS[task](tmp_path):
        tally = fuzz.fuzz(kind, BOUND, seed=0)
        assert tally.failures == (), kind.name
        refused += tally.refused
    assert refused > BOUND


def test_what_is_a_failure_is_found(tmp_path):
    """A reader that breaks, one that hangs and one that refuses in two lines."""
    path = tmp_path / "file"
    path.write_text(json.dumps({"a": 1}))
    whole = path.read_bytes()

    def careless():
        json.loads(path.read_bytes())["a"] + 1

    def wordy():
        if path.read_bytes() != whole:
            raise InputError("two\nlines", file=None)

    class WordyError(InputError):
        def __str__(self):
            return "two\nlines"

    def two_lines():
        if path.read_bytes() != whole:
            raise WordyError("x")

    for read in (careless, two_lines):
        assert fuzz.fuzz(fuzz.Kind("file", path, read), 20, seed=0).failures
    assert not fuzz.fuzz(fuzz.Kind("file", path, wordy), 20, seed=0).failures
    assert path.read_bytes() == whole


def test_mutations_change_something_and_reach_every_field():
    value = {"a": [1, {"b": None}], "c": "text"}
    made = {fuzz.mutate_json(value, random.Random(k)) for k in range(300)}
    assert len(made) > 100
    for kept in ('"b": ', '"c": "text"', '"a": [1, {"b": null}]'):
        assert any(kept in text for text in made)
        assert any(kept not in text for text in made)
