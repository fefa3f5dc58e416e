"""Counts of an evaluation add up, and every draw that was refused is told, with its reason."""

import json
from functools import partial

import pytest

from deggflow.app.runs import run_jobs
from deggflow.app.tables import show
from deggflow.tasks.tabletop import evaluate as module
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.evaluate import evaluate
from deggflow.tasks.tabletop.formats import parse_scene
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.options import TabletopEvaluate
from deggflow.tasks.tabletop.oracle import refutes
from deggflow.tasks.tabletop.report import evaluation_of

CASES, SIZE, SEED, DRAWS = 4, 8, 4, 3
IMPOSSIBLE = SceneCondition(("laptop", "desk_lamp"), width=0.1, depth=0.1)


@pytest.fixture(autouse=True)
def one_is_impossible(monkeypatch):
    """Number 2 has no room; few steps, as in other tests, so that programs are compiled once."""

    def drawn(size, count, family, seed):
        conditions = random_conditions(size, count, family, seed)
        return [*conditions[:2], IMPOSSIBLE, *conditions[3:]]

    monkeypatch.setattr(module, "random_conditions", drawn)
    monkeypatch.setattr(module, "TabletopGenerator", partial(TabletopGenerator, steps=12))


def test_every_refused_draw_is_told(field):
    refused = []
    row = evaluate(field, SIZE, "changed", CASES, SEED, DRAWS, on_failure=refused.append)
    assert (row.cases, row.satisfied, row.refuted, row.most_draws) == (CASES, CASES - 1, 0, DRAWS)
    of_the_impossible = [each for each in refused if each.number == 2]
    assert [each.scene.certificate.draws for each in of_the_impossible] == [1, 2, 3]
    assert row.first_draw == CASES - sum(each.scene.certificate.draws == 1 for each in refused)
    assert row.least_margin >= 0
    for each in refused:
        assert refutes(each.scene.condition, each.scene.poses)
        assert not each.scene.certificate.satisfied
    assert (
        row.hypotheses_hold + row.with_forced_steps <= CASES
    )  # with a forced step they do not hold
    assert 0 <= row.contradicted <= row.hypotheses_hold
    median, high, most = row.evaluations
    assert 13 <= median <= high <= most <= 13 + 12 * 5 * 16  # halved four times at most


def test_refused_draws_stand_in_a_file_one_a_line(field, tmp_path, capsys):
    """And what runs twice adds nothing that it has not done again."""
    out, failures = tmp_path / "rows.jsonl", tmp_path / "failures.jsonl"
    options = TabletopEvaluate(
        sizes=(SIZE,), cases=CASES, seed=SEED, max_draws=DRAWS, failures=failures, evaluations=12
    )

    def run():
        evaluation = evaluation_of(field, options, None)
        rows = run_jobs(evaluation.jobs, evaluation.row, evaluation.settings, out)
        for table in evaluation.tables(rows):
            show(table)
        return evaluation.complete(rows)

    assert not run()
    told = capsys.readouterr().out
    assert "75.0%" in told  # satisfied
    assert "generation of the first draws" in told
    lines = failures.read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert {2} <= {row["number"] for row in rows}
    for row in rows:
        assert set(row) == {"number", "scene"}
        scene = parse_scene(row["scene"])
        assert scene.seed == SEED
        assert scene.certificate.reason
        assert not scene.verdict().satisfied
    reasons = [row["scene"]["certificate"]["reason"] for row in rows if row["number"] == 2]
    assert len(reasons) == DRAWS
    assert all("laptop" in reason or "desk_lamp" in reason for reason in reasons)
    assert not run()
    assert capsys.readouterr().out == told
    assert failures.read_text().splitlines() == lines
