"""Baselines on the tabletop: their margins by the independent verdict, and what is counted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.tabletop.baselines import BASELINES, METHODS, flat_margins
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.codec import decode_exactly
from deggflow.tasks.tabletop.condition import take, to_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.frontier import Point, best, draw_cases, measure
from deggflow.tasks.tabletop.verdict import judge

NAMES = {method.name: method for method in METHODS}


@pytest.fixture(scope="module")
def field():
    return load_field()


@pytest.fixture(scope="module")
def cases(field):
    return draw_cases(field, 4, "changed", 12, 3)


@pytest.mark.parametrize("size", [3, 8])
def test_the_least_margin_is_the_verdicts(size):
    rng = np.random.default_rng(size)
    conditions = random_conditions(size, 10, "changed", 5)
    arrays = jax.tree.map(jnp.asarray, to_arrays(conditions))
    for k, condition in enumerate(conditions):
        z = rng.normal(size=(arrays.mask.shape[1], 3)).astype(np.float32) * 0.5
        verdict = judge([condition], [decode_exactly(z, condition)])[0]
        least = float(jnp.min(flat_margins(jnp.asarray(z), take(arrays, k))))
        assert least == pytest.approx(verdict.min_margin, abs=1e-5)


def test_nothing_is_drawn_again_where_all_is_satisfied_and_nominal_deviates_by_nothing(
    field, cases
):
    once = measure(field, NAMES["rejection sampling"], {"draws": 1.0}, cases)
    again = measure(field, NAMES["rejection sampling"], {"draws": 16.0}, cases)
    assert once.deviation == pytest.approx(0.0, abs=1e-6)
    assert once.draws == 1.0
    assert 0 < once.satisfied < once.cases
    assert again.satisfied > once.satisfied
    assert 1.0 < again.draws <= 16.0
    assert again.deviation > 0.1


def test_the_shipped_guidance_satisfies_every_case(field, cases):
    point = measure(field, NAMES["pooled"], NAMES["pooled"].default, cases)
    assert (point.satisfied, point.worst, point.diverged) == (12, 0.0, 0)
    assert 0.0 < point.transport <= point.deviation + 1e-6
    assert point.seconds > 0


def test_a_baseline_is_measured_at_each_of_its_settings(field, cases):
    weak, strong = (
        measure(field, NAMES["penalty gradient"], {"gain": gain}, cases) for gain in (1e-3, 5.0)
    )
    nominal = measure(field, NAMES["rejection sampling"], {"draws": 1.0}, cases)
    assert weak.satisfied <= strong.satisfied
    assert weak.deviation < 0.01 < strong.deviation
    assert weak.worst == pytest.approx(nominal.worst, abs=2e-3)


def test_diverged_samples_count_as_failures(field, cases):
    point = measure(field, NAMES["penalty gradient"], {"gain": 1e9}, cases)
    assert point.diverged > 0
    assert point.satisfied + point.diverged <= point.cases
    assert (point.transport is None) == (point.diverged == point.cases)


def test_the_best_setting_has_the_most_successes_then_the_least_transport():
    def point(satisfied, transport):
        return Point("way", {}, 8, 10, satisfied, 0, 0.0, transport, transport, 0.1, 1.0)

    near, far, failing = point(9, 0.1), point(9, 0.3), point(8, 0.0)
    assert best([far, failing, near]) is near


def test_every_baseline_stands_in_tables_at_a_setting_of_its_grid():
    for method in METHODS:
        assert method.default in method.grid
        assert method.chosen(8) == method.default
        assert method.chosen(12) in method.grid
    assert len({method.name for method in BASELINES}) == len(BASELINES) == 7
