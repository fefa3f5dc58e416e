"""A real scene and a real trial, every field changed: no contradiction passes but in fields that are named."""

import json

import pytest
import tamper

CONTACTS = [[-2.4, 0.36], [-2.4, -0.36], [-1.0, 0.36]]
START = {
    "plank": {"x": -1.2, "y": 0.0, "theta": 0.1},
    "goal": {"x": -0.2, "y": 0.0, "theta": 0.0},
    "contacts": CONTACTS,
}
SCENE = ("--size", 4, "--requirements", "balanced", "--trace", "--seed", 2, "--out", "s.jsonl")
TRIAL = ("--conditions", "c.jsonl", "--seed", 5, "--speed-limit", 0.3, "--out", "t.jsonl")


@pytest.fixture
def lines(inside, tmp_path):
    """A scene and a trial as the commands write them."""
    (tmp_path / "c.jsonl").write_text(json.dumps(START) + "\n")
    assert inside("tabletop", "generate", *SCENE).returncode == 0
    assert inside("bridge", "generate", *TRIAL).returncode == 0
    return [json.loads((tmp_path / name).read_text()) for name in ("s.jsonl", "t.jsonl")]


def test_no_contradiction_passes_but_in_fields_that_are_named(lines):
    for kind, line in zip((tamper.SCENE, tamper.TRIAL), lines, strict=True):
        rows = tamper.tamper(kind, line, most=2)
        assert tamper.passing(kind, rows) == []
        assert sum(row.found for row in rows) > 100
        said = {row.field: row for row in rows}
        for name in ("satisfied", "min_margin", "violation", "reason"):
            row = said[f"certificate.{name}"]
            assert (row.found, row.unfound) == (row.changes, [])
        text = "\n".join(tamper.table(kind, rows))
        assert all(f"| `{name}` |" in text for name in ("seed", "certificate.satisfied"))


def test_what_is_not_named_must_be_found():
    """A field that is named does not excuse the fields beside it."""
    named = {"seed": "", "a.generation": "", "a.generation.steps": "", "a.trace": ""}
    for name in ("seed", "a.generation", "a.generation.steps", "a.trace.tau[]", "a.trace[]"):
        assert tamper.is_named(name, named)
    for name in (
        "seeds",
        "a",
        "a.generation.hypotheses_hold",
        "a.generation.steps_",
        "b.generation",
    ):
        assert not tamper.is_named(name, named)
    row = tamper.Row("a.hypotheses_hold", changes=1, unfound=["true -> false"])
    kind = tamper.SCENE._replace(unverified=named)
    assert tamper.passing(kind, [row]) == ["scene: true -> false"]
