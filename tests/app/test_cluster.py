"""`--engine ray`: what its workers compute is what one process does. benchmarks/ray_faults.py runs a real cluster."""

import json
import sys

import pytest

from deggflow.app.cluster import Work, generate_chunk, measure_row
from deggflow.app.runs import provenance
from deggflow.jsonl import InputError
from deggflow.shards import Part
from deggflow.tasks.tabletop.model import TabletopModel
from deggflow.tasks.tabletop.options import TabletopEvaluate, TabletopGenerate


def test_workers_make_the_lines_of_one_process(inside, tmp_path, small_weights):
    """By number and from a file; by chunks and by rows; and only with the driver's weights."""
    shown = ("--guidance", "none", "--weights", small_weights)
    whole = inside("tabletop", "generate", "--size", 4, "--count", 3, *shown).stdout.splitlines()
    options = TabletopGenerate(size=4, count=3, guidance="none", weights=small_weights)
    made_with = provenance(TabletopModel(), small_weights)
    work = Work("tabletop", options, made_with)
    text, failed = generate_chunk(work, Part(0, 3, 3), 512, None)
    assert text.split("\n") == whole
    rows = [json.loads(line) for line in whole]
    assert failed == [not row["certificate"]["satisfied"] for row in rows]
    conditions = [row["condition"] for row in rows]
    given = work._replace(options=TabletopGenerate(guidance="none", weights=small_weights))
    assert generate_chunk(given, Part(0, 3, 3), 512, conditions)[0].split("\n") == whole
    with pytest.raises(InputError, match="a worker has other weights or another version"):
        generate_chunk(work._replace(made_with={}), Part(0, 3, 3), 512, None)
    with pytest.raises(InputError, match="a worker has other weights or another version"):
        measure_row(work._replace(options=TabletopEvaluate()), None, 0)


def test_options_of_the_engine_are_checked_before_anything_runs(inside, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    generate = ("tabletop", "generate", "--size", 2)
    for arguments, hint in (
        ((*generate, "--engine", "ray"), "needs the package ray: pip install 'deggflow[ray]'"),
        ((*generate, "--address", "auto"), "--address goes with --engine ray"),
        ((*generate, "--cpus", 0), "--cpus must lie in [1, 1024]"),
        (("bridge", "evaluate", "--engine", "ray"), "pip install 'deggflow[ray]'"),
    ):
        refused = inside(*arguments)
        assert (refused.returncode, hint in refused.stderr) == (2, True), refused.stderr
