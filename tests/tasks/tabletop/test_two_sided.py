"""Deviations case by case: the same as in the comparison of methods, and between both bounds."""

import json

import numpy as np
import pytest

from deggflow.schema import parse_as
from deggflow.tasks.tabletop.baselines import METHODS
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.frontier import draw_cases, measure
from deggflow.tasks.tabletop.two_sided import LOWER, NEAREST, CaseDeviations, jobs

NAMES = {method.name: method for method in METHODS}
SIZE, CASES, SEED = 3, 12, 5
CHOSEN = ("pooled", "predict, then pooled", "rejection sampling")


@pytest.fixture(scope="module")
def rows():
    grid = [(SIZE, each) for each in (LOWER, NEAREST, *(NAMES[name] for name in CHOSEN))]
    todo = jobs(load_field(), grid, CASES, SEED, NAMES["predict, then pooled"])
    return {row.method: row for row in (job() for job in todo)}


@pytest.mark.slow
def test_both_bounds_hold_case_by_case(rows):
    lower, nearest = (np.array(rows[name].squared) for name in (LOWER, NEAREST))
    assert 0 < sum(rows[LOWER].satisfied) < CASES
    np.testing.assert_array_equal(lower == 0, rows[LOWER].satisfied)
    assert all(rows[NEAREST].satisfied)
    for name in CHOSEN:
        squared, satisfied = np.array(rows[name].squared), np.array(rows[name].satisfied)
        assert np.all(squared[satisfied] >= nearest[satisfied] - 1e-9)
        assert np.all(squared[satisfied] >= lower[satisfied])
        if name == "rejection sampling":
            assert rows[name].upper == [None] * CASES
        else:
            upper = np.array(rows[name].upper)
            assert np.all(squared <= upper * (1 + 1e-6))
            assert np.mean(upper) < 20 * np.mean(squared)


@pytest.mark.slow
def test_deviations_are_those_of_the_comparison(rows):
    field = load_field()
    cases = draw_cases(field, SIZE, "changed", CASES, SEED)
    for name in ("pooled", "rejection sampling"):
        point = measure(field, NAMES[name], NAMES[name].chosen(SIZE), cases)
        assert np.sqrt(np.mean(rows[name].squared)) == pytest.approx(point.deviation, rel=1e-4)
        assert sum(rows[name].satisfied) == point.satisfied


@pytest.mark.slow
def test_rows_survive_a_file(rows):
    for row in rows.values():
        assert parse_as(CaseDeviations, json.loads(json.dumps(row.to_json()))) == row
