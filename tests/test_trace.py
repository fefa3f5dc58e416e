"""Summaries of traces that are made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import DecoupledGuidance, PrivateRequirement, generate, refined_grid, step_guard
from deggflow.guidance import GuidanceReport
from deggflow.trace import Point, add_point, as_accepted, empty_summary, traced

POINTS, ROWS, AGENTS = 4, 2, 3
EPS = float(np.finfo(np.float32).eps)


def reports(**changed):
    """Nothing happens: values are one below their limits, every row is feasible and everybody at rest."""
    shape = (POINTS, ROWS, AGENTS)
    no = np.zeros(shape, bool)
    parts = {
        "value": np.zeros((POINTS, ROWS)),
        "bound": np.full((POINTS, ROWS), 0.5),
        "limit": np.ones((POINTS, ROWS)),
        "row_feasible": np.ones(shape, bool),
        "qp_infeasible": np.zeros((POINTS, AGENTS), bool),
        "input_norm": np.zeros((POINTS, AGENTS)),
        "ell_norm": np.full(shape, np.inf),
        "active": no,
        "opposed_sine": np.ones((POINTS, AGENTS)),
        "slope": np.zeros((POINTS, ROWS)),
        "contribution": np.zeros(shape),
        "drift_nan": np.zeros((POINTS, AGENTS), bool),
        "value_nan": no,
        "gradient_nan": no,
        "input_nan": np.zeros((POINTS, AGENTS), bool),
    }
    made = parts | {name: _set(parts[name].copy(), at) for name, at in changed.items()}
    return GuidanceReport(**{name: jnp.asarray(part) for name, part in made.items()})


def _set(part, at):
    for index, value in at.items():
        part[index] = value
    return part


TAU = np.linspace(0, 1, POINTS)


def folded(report, present, forced, over, kinks, accepted, z):
    def step(so_far, k):
        one = jax.tree.map(lambda leaf: leaf[k], report)
        point = Point(
            jnp.asarray(TAU, jnp.float32)[k], z[k], one, accepted[k], ~accepted[k], over[k],
            forced[k], kinks[k], k == POINTS - 1,
        )  # fmt: skip
        return add_point(so_far, point, present), None

    start = empty_summary(jnp.asarray(TAU, jnp.float32), z[0], None, ROWS)
    return jax.lax.scan(step, start, jnp.arange(POINTS))[0]


def summary(present=None, forced=(), over=(), kinks=(), refused=(), z=None, **changed):
    """Of points that are all accepted, but those that are refused."""
    flags = np.zeros((2, POINTS), bool)
    flags[0, list(forced)] = True
    flags[1, list(refused)] = True
    rows = np.zeros((2, POINTS, ROWS), bool)
    for part, at in zip(rows, (over, kinks), strict=True):
        for index in at:
            part[index] = True
    z = np.zeros((POINTS, AGENTS, 2), np.float32) if z is None else z
    given = (flags[0], rows[0], rows[1], ~flags[1], z)
    return jax.jit(folded)(reports(**changed), present, *map(jnp.asarray, given))


def test_where_nothing_happens_the_hypotheses_hold():
    one = summary(value={(-1, 1): 0.25})
    assert one.hypotheses_hold
    np.testing.assert_array_equal(one.value, [0.0, 0.25])
    np.testing.assert_array_equal(one.limit, [1.0, 1.0])
    np.testing.assert_array_equal(one.excess, [-1.0, -0.75])
    np.testing.assert_array_equal(one.active_points, 0)
    assert np.all(np.isinf(one.smallest_ell_norm))
    assert one.least_opposed_sine == 1
    assert int(one.work.evaluations) == POINTS


@pytest.mark.parametrize("point", range(POINTS))
def test_a_value_above_its_limit_at_any_point_is_found(point):
    """At tau = 1 too, and at the start."""
    one = summary(value={(point, 1): 1.125})
    np.testing.assert_array_equal(one.excess, [-1.0, 0.125])
    assert not one.hypotheses_hold


def test_what_rounding_adds_to_the_first_point_is_left_out():
    """A bound starts from the value itself; of no later point so."""
    start = {(0, 0): 1.0 + 2 * EPS}
    level = {(k, 0): 1.0 for k in range(POINTS)}
    first = summary(value=level | start)
    assert first.excess[0] == 0
    assert first.hypotheses_hold
    assert not summary(value=level | {(0, 0): 1.0 + 16 * EPS}).hypotheses_hold
    assert not summary(value=level | {(1, 0): 1.0 + 2 * EPS}).hypotheses_hold


def test_no_input_follows_the_last_point():
    at = (-1, 0, 1)
    last = summary(
        row_feasible={at: False},
        qp_infeasible={(-1, 1): True},
        input_norm={(-1, 1): np.nan, (0, 1): 2.0},
        ell_norm={at: 0.1},
        active={at: True},
        opposed_sine={(-1, 1): 0.1},
    )
    assert last.hypotheses_hold
    np.testing.assert_array_equal(last.largest_input_norm, [0.0, 2.0, 0.0])
    np.testing.assert_array_equal(last.active_points, 0)
    assert np.all(np.isinf(last.smallest_ell_norm))
    assert last.least_opposed_sine == 1


@pytest.mark.parametrize("point", range(POINTS - 1))
@pytest.mark.parametrize("what", ["row_feasible", "qp_infeasible"])
def test_failed_conditions_are_counted_where_they_failed(what, point):
    infeasible, qp_infeasible = np.zeros((ROWS, AGENTS)), np.zeros(AGENTS)
    if what == "row_feasible":
        one = summary(row_feasible={(point, 1, 2): False})
        infeasible[1, 2] = 1
    else:
        one = summary(qp_infeasible={(point, 2): True})
        qp_infeasible[2] = 1
    assert not one.hypotheses_hold
    np.testing.assert_array_equal(one.infeasible_points, infeasible)
    np.testing.assert_array_equal(one.qp_infeasible_points, qp_infeasible)


def test_figures_of_what_was_done():
    one = summary(
        active={(0, 0, 0): True, (0, 0, 1): True, (2, 0, 1): True, (1, 1, 2): True},
        ell_norm={(0, 0, 0): 0.7, (2, 0, 1): 0.3, (1, 1, 2): 5.0},
        input_norm={(0, 0): 1.5, (1, 0): 4.0, (2, 2): 2.0},
        opposed_sine={(1, 0): 0.5, (2, 2): 0.25},
    )
    np.testing.assert_array_equal(one.active_points, [2, 1])  # points, not agents
    np.testing.assert_allclose(one.smallest_ell_norm, [0.3, 5.0])
    np.testing.assert_array_equal(one.largest_input_norm, [4.0, 0.0, 2.0])
    assert one.least_opposed_sine == 0.25
    assert one.hypotheses_hold  # of its own none of this breaks anything


def test_agents_that_are_not_there_count_for_nothing():
    """Padding may report what it likes."""
    changed = {
        "row_feasible": {(1, 0, 2): False},
        "qp_infeasible": {(1, 2): True},
        "input_norm": {(1, 2): 9.0, (1, 1): 1.0},
        "ell_norm": {(1, 0, 2): 0.01, (1, 0, 1): 0.5},
        "active": {(1, 0, 2): True},
        "opposed_sine": {(1, 2): 0.01},
    }
    one = summary(jnp.array([True, True, False]), **changed)
    assert one.hypotheses_hold
    np.testing.assert_array_equal(one.largest_input_norm, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(one.active_points, 0)
    np.testing.assert_array_equal(one.smallest_ell_norm, [0.5, np.inf])
    assert one.least_opposed_sine == 1
    everybody = summary(**changed)
    assert not everybody.hypotheses_hold
    assert everybody.least_opposed_sine == pytest.approx(0.01)


@pytest.mark.parametrize("point", range(POINTS))
@pytest.mark.parametrize("part", ["value", "limit"])
def test_what_is_not_a_number_is_above_its_limit(part, point):
    one = summary(**{part: {(point, 0): np.nan}})
    np.testing.assert_array_equal(one.excess, [np.inf, -1.0])
    assert not one.hypotheses_hold


def test_a_step_that_was_forced_breaks_the_promise_and_names_whose_it_was():
    """Agents whose part of the value is at least half of the largest."""
    one = summary(
        forced=[1, 2],
        over=[(1, 0), (2, 0)],
        contribution={(1, 0, 0): 4.0, (1, 0, 1): 2.5, (1, 0, 2): 1.0, (2, 0, 2): 1.0},
    )
    assert not one.hypotheses_hold
    assert int(one.work.forced_steps) == 2
    np.testing.assert_array_equal(one.forced_steps, [[1, 1, 1], [0, 0, 0]])


def test_a_refused_point_counts_as_work_and_nothing_else():
    """Whatever it reports; the points on either side of it are the record's."""
    everything = {
        "value": {(1, 0): 9.0},
        "row_feasible": {(1, 0, 0): False},
        "qp_infeasible": {(1, 0): True},
        "input_norm": {(1, 0): 7.0},
        "ell_norm": {(1, 0, 0): 1e-9},
        "active": {(1, 0, 0): True},
        "opposed_sine": {(1, 0): 0.1},
        "drift_nan": {(1, 0): True},
        "gradient_nan": {(1, 0, 0): True},
    }
    one, none = summary(refused=[1], **everything), summary(refused=[1])
    assert one.hypotheses_hold
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(none), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (int(one.work.evaluations), int(one.work.refused_steps), int(one.points)) == (4, 1, 3)


def test_the_largest_step_is_of_one_agent_between_accepted_points():
    z = np.zeros((POINTS, AGENTS, 2), np.float32)
    z[1:, 1] += [3.0, 4.0]
    z[2, 2] = 100.0  # refused, and gone again
    z[3, 0] = 1.0
    one = summary(refused=[2], z=jnp.asarray(z))
    assert float(one.largest_step) == pytest.approx(5.0)
    absent = summary(jnp.array([True, False, True]), refused=[2], z=jnp.asarray(z))
    assert float(absent.largest_step) == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize("what", ["drift_nan", "value_nan", "gradient_nan", "input_nan"])
def test_what_is_not_a_number_is_known_by_its_first_tau(what):
    inside = what in ("value_nan", "gradient_nan")
    at = {((k, 1, 2) if inside else (k, 2)): True for k in (1, 2)}
    one = summary(**{what: at})
    assert not one.hypotheses_hold
    assert one.not_a_number
    first = getattr(one.nan, what.removesuffix("_nan"))
    expected = np.full(first.shape, np.inf)
    expected[(1, 2) if inside else (2,)] = np.float32(TAU[1])
    np.testing.assert_array_equal(first, expected)


def test_hypotheses_fail_at_a_point_without_a_gradient():
    one = summary(kinks=[(2, 1)])
    assert not one.hypotheses_hold
    np.testing.assert_array_equal(one.kink_points, [0, 1])


def test_many_at_once():
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), summary(), summary(value={(1, 0): 2.0}))
    np.testing.assert_array_equal(both.hypotheses_hold, [True, False])


ABOVE = 1.0 + EPS, 1.0 + 1e-4  # a limit of 1: by rounding, and by more


@pytest.mark.parametrize(("forced", "above"), [(0, ABOVE[0]), (1, ABOVE[0]), (0, ABOVE[1])])
def test_what_was_accepted_is_at_most_its_limit(forced, above):
    """Rounding may write a value down above the limit that it was accepted under; z(0) was compared with none.

    What is further above stays, whatever the counter says.
    """
    report = reports(value={(2, 0): above, (0, 1): 3.0})
    never, none = jnp.zeros(POINTS, bool), jnp.zeros((POINTS, ROWS), bool)
    z = jnp.zeros((POINTS, AGENTS, 2))
    summary = folded(report, None, never, none, none, ~never, z)
    count = jnp.asarray(forced, jnp.int32)
    summary = summary._replace(
        value=report.value[2], work=summary.work._replace(forced_steps=count)
    )
    summary, trace = as_accepted(summary, traced(report))
    stays = bool(forced) or above == ABOVE[1]
    assert (float(trace[0][2, 0]) > float(trace[2][2, 0])) == stays
    assert (float(summary.value[0]) > float(summary.limit[0])) == stays
    assert (float(summary.excess[0]) > 0) == stays
    assert float(summary.excess[1]) == 2.0
    assert float(trace[0][0, 1]) == 3.0


def test_a_counter_that_misses_a_forced_step_shows(monkeypatch):
    """Steps are taken above their limits, and nothing says so: the value does."""
    counting = step_guard.add_point

    def miscounting(so_far, point, mask):
        return counting(so_far, point._replace(forced=jnp.zeros_like(point.forced)), mask)

    monkeypatch.setattr(step_guard, "add_point", miscounting)

    def drift(tau, z, condition):
        return jnp.ones_like(z)

    # Without inputs nothing keeps z below 1/2.
    guidance = DecoupledGuidance(
        (PrivateRequirement(lambda z, _: 0.5 - z, 0.05),),
        control=lambda tau, z, _: jnp.zeros((1, 1, 1)),
    )
    out = generate(drift, guidance, jnp.zeros((1, 1)), None, grid=refined_grid(4))
    assert int(out.work.forced_steps) == 0
    assert float(out.summary.excess[0]) > 0.1
    assert float(jnp.max(out.trace.value - out.trace.limit)) > 0.1
    assert not out.summary.hypotheses_hold
