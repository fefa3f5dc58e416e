"""`--engine ray`: what its workers compute is what one process does. benchmarks/ray_faults.py runs a real cluster."""

import json
import sys
from dataclasses import replace

import pytest

from deggflow.app.cluster import (
    Work,
    demonstrate_chunk,
    demonstrator_by,
    generate_chunk,
    measure_method,
    measure_row,
    rows_by,
)
from deggflow.app.runs import provenance
from deggflow.jsonl import InputError
from deggflow.shards import Part, Shard
from deggflow.task import write_data
from deggflow.tasks.tabletop.baselines import METHODS
from deggflow.tasks.tabletop.frontier import Point, jobs
from deggflow.tasks.tabletop.model import TabletopModel
from deggflow.tasks.tabletop.options import SceneRecipe, TabletopEvaluate, TabletopGenerate


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


class HereAndNow:
    """A cluster whose workers are this process."""

    def each(self, function, calls):
        return (function(*call) for call in calls)


def test_workers_make_the_demonstrations_of_one_process(tmp_path):
    """Those of a folder that was begun without a cluster, too; and only with the driver's version."""
    model, recipe = TabletopModel(), SceneRecipe(training=3, validation=2, sizes=(2, 3))
    write_data(model, tmp_path / "here", recipe)
    begun = tmp_path / "there" / "training.jsonl"
    whole = (tmp_path / "here" / "training.jsonl").read_text()
    write_data(model, tmp_path / "there", recipe)
    begun.write_text("".join(whole.splitlines(keepends=True)[:4]))
    by_cluster = demonstrator_by(HereAndNow(), "tabletop", recipe)
    write_data(model, tmp_path / "there", recipe, demonstrator=by_cluster)
    for name in ("training.jsonl", "validation.jsonl"):
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()
    with pytest.raises(InputError, match="a worker has other weights or another version"):
        demonstrate_chunk(Work("tabletop", recipe, {}), None)


def test_workers_measure_the_methods_of_one_process():
    """Rows of a shard are asked for in order."""
    work = Work("tabletop", (4, 7), provenance(TabletopModel(), None))
    calls = [
        (work, 3, name, setting)
        for name, setting in (
            ("penalty gradient", {"gain": 0.5}),
            ("rejection sampling", {"draws": 1.0}),
        )
    ]
    shard = Shard(2, 2)
    *_, job = rows_by(HereAndNow(), measure_method, calls, Point, shard)
    by_worker = job()
    (method,) = (each for each in METHODS if each.name == "rejection sampling")
    (here,) = jobs(TabletopModel().load(None), [(3, method, {"draws": 1.0})], 4, 7)
    assert replace(by_worker, seconds=0.0) == replace(here(), seconds=0.0)


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
