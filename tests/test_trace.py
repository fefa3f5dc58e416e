"""Summaries of traces that are made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.trace import Trace, Work, summarise

POINTS, ROWS, AGENTS = 4, 2, 3
EPS = float(np.finfo(np.float32).eps)


def trace(**changed):
    """Nothing happens: values are one below their limits, everybody is able and at rest."""
    shape = (POINTS, ROWS, AGENTS)
    parts = {
        "tau": np.linspace(0, 1, POINTS),
        "value": np.zeros((POINTS, ROWS)),
        "bound": np.full((POINTS, ROWS), 0.5),
        "limit": np.ones((POINTS, ROWS)),
        "able": np.ones(shape, bool),
        "infeasible": np.zeros((POINTS, AGENTS), bool),
        "effort": np.zeros((POINTS, AGENTS)),
        "length": np.full(shape, np.inf),
        "active": np.zeros(shape, bool),
        "sine": np.ones((POINTS, AGENTS)),
    }
    made = parts | {name: _set(parts[name].copy(), at) for name, at in changed.items()}
    return Trace(**{name: jnp.asarray(part) for name, part in made.items()})


def _set(part, at):
    for index, value in at.items():
        part[index] = value
    return part


def summary(present=None, above=0, **changed):
    work = Work(jnp.asarray(POINTS), jnp.asarray(0), jnp.asarray(above))
    return summarise(trace(**changed), work, present)


def test_where_nothing_happens_everything_held():
    one = summary(value={(-1, 1): 0.25})
    assert one.held
    np.testing.assert_array_equal(one.value, [0.0, 0.25])
    np.testing.assert_array_equal(one.limit, [1.0, 1.0])
    np.testing.assert_array_equal(one.excess, [-1.0, -0.75])
    np.testing.assert_array_equal(one.active, 0)
    assert np.all(np.isinf(one.length))
    assert one.sine == 1
    assert int(one.work.evaluations) == POINTS


@pytest.mark.parametrize("point", range(POINTS))
def test_a_value_above_its_limit_at_any_point_is_found(point):
    """At tau = 1 too, and at the start."""
    one = summary(value={(point, 1): 1.125})
    np.testing.assert_array_equal(one.excess, [-1.0, 0.125])
    assert not one.held


def test_what_rounding_adds_to_the_first_point_is_left_out():
    """A bound starts from the value itself; of no later point so."""
    start = {(0, 0): 1.0 + 2 * EPS}
    level = {(k, 0): 1.0 for k in range(POINTS)}
    first = summary(value=level | start)
    assert first.excess[0] == 0
    assert first.held
    assert not summary(value=level | {(0, 0): 1.0 + 16 * EPS}).held
    assert not summary(value=level | {(1, 0): 1.0 + 2 * EPS}).held


def test_no_input_follows_the_last_point():
    at = (-1, 0, 1)
    last = summary(
        able={at: False},
        infeasible={(-1, 1): True},
        effort={(-1, 1): np.nan, (0, 1): 2.0},
        length={at: 0.1},
        active={at: True},
        sine={(-1, 1): 0.1},
    )
    assert last.held
    np.testing.assert_array_equal(last.effort, [0.0, 2.0, 0.0])
    np.testing.assert_array_equal(last.active, 0)
    assert np.all(np.isinf(last.length))
    assert last.sine == 1


@pytest.mark.parametrize("point", range(POINTS - 1))
@pytest.mark.parametrize("what", ["able", "infeasible"])
def test_failed_conditions_are_counted_where_they_failed(what, point):
    stuck, infeasible = np.zeros((ROWS, AGENTS)), np.zeros(AGENTS)
    if what == "able":
        one = summary(able={(point, 1, 2): False})
        stuck[1, 2] = 1
    else:
        one = summary(infeasible={(point, 2): True})
        infeasible[2] = 1
    assert not one.held
    np.testing.assert_array_equal(one.stuck, stuck)
    np.testing.assert_array_equal(one.infeasible, infeasible)


def test_figures_of_what_was_done():
    one = summary(
        active={(0, 0, 0): True, (0, 0, 1): True, (2, 0, 1): True, (1, 1, 2): True},
        length={(0, 0, 0): 0.7, (2, 0, 1): 0.3, (1, 1, 2): 5.0},
        effort={(0, 0): 1.5, (1, 0): 4.0, (2, 2): 2.0},
        sine={(1, 0): 0.5, (2, 2): 0.25},
    )
    np.testing.assert_array_equal(one.active, [2, 1])  # points, not agents
    np.testing.assert_allclose(one.length, [0.3, 5.0])
    np.testing.assert_array_equal(one.effort, [4.0, 0.0, 2.0])
    assert one.sine == 0.25
    assert one.held  # of its own none of this breaks anything


def test_agents_that_are_not_there_count_for_nothing():
    """Padding may report what it likes."""
    changed = {
        "able": {(1, 0, 2): False},
        "infeasible": {(1, 2): True},
        "effort": {(1, 2): 9.0, (1, 1): 1.0},
        "length": {(1, 0, 2): 0.01, (1, 0, 1): 0.5},
        "active": {(1, 0, 2): True},
        "sine": {(1, 2): 0.01},
    }
    one = summary(jnp.array([True, True, False]), **changed)
    assert one.held
    np.testing.assert_array_equal(one.effort, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(one.active, 0)
    np.testing.assert_array_equal(one.length, [0.5, np.inf])
    assert one.sine == 1
    everybody = summary(**changed)
    assert not everybody.held
    assert everybody.sine == pytest.approx(0.01)


@pytest.mark.parametrize("point", range(POINTS))
@pytest.mark.parametrize("part", ["value", "limit"])
def test_what_is_not_a_number_is_above_its_limit(part, point):
    one = summary(**{part: {(point, 0): np.nan}})
    np.testing.assert_array_equal(one.excess, [np.inf, -1.0])
    assert not one.held


def test_a_step_that_was_forced_breaks_the_promise():
    """Between points of the grid a value may be above its limit without a trace."""
    assert not summary(above=1).held


def test_many_traces_at_once():
    one, other = trace(), trace(value={(1, 0): 2.0})
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), one, other)
    work = Work(*(jnp.zeros(2, int) for _ in range(3)))
    found = jax.vmap(lambda trace, work: summarise(trace, work).held)(both, work)
    np.testing.assert_array_equal(found, [True, False])
