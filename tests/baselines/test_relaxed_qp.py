"""The barrier methods' QP against quadprog, slack variables written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quadprog

from deggflow.baselines.relaxed_qp import relaxed_input


def reference(ell, b, slack):
    """u and s together: min u @ u + slack s @ s, subject to ell @ u - s <= -b."""
    count, inputs = ell.shape
    cost = np.diag(np.concatenate([np.ones(inputs), np.full(count, slack)]))
    rows = np.concatenate([-ell, np.eye(count)], axis=1)
    return quadprog.solve_qp(cost, np.zeros(inputs + count), rows.T, b)[0][:inputs]


def solve(ell, b, rows, slack):
    with jax.enable_x64(True):
        found = jax.jit(relaxed_input, static_argnames=("rows", "slack"))(
            jnp.asarray(ell), jnp.asarray(b), rows=rows, slack=slack
        )
        return np.asarray(found)


@pytest.mark.parametrize("slack", [1.0, 1e4])
def test_agrees_with_quadprog_where_all_rows_are_looked_at(slack):
    rng = np.random.default_rng(0)
    for _ in range(40):
        ell, b = rng.normal(size=(6, 4)), rng.normal(size=6)
        assert solve(ell, b, 6, slack) == pytest.approx(reference(ell, b, slack), abs=1e-8)


def test_rows_that_contradict_each_other_both_give_way():
    ell, b = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 3.0])
    assert solve(ell, b, 2, 100.0) == pytest.approx(reference(ell, b, 100.0), abs=1e-10)


def test_a_row_that_nobody_can_change_counts_for_nothing():
    ell, b = np.array([[0.0, 0.0], [0.0, 2.0]]), np.array([5.0, 1.0])
    alone = solve(ell[1:], b[1:], 1, 1e4)
    assert solve(ell, b, 2, 1e4) == pytest.approx(alone)
    assert alone == pytest.approx([0.0, -0.5], abs=1e-3)


def test_rows_left_out_stay_satisfied_by_inputs_shorter_than_their_distance():
    rng = np.random.default_rng(1)
    for _ in range(20):
        ell, b = rng.normal(size=(40, 5)), rng.normal(size=40) - 1.0
        u = solve(ell, b, 8, 1e6)
        distance = np.sort(b / np.linalg.norm(ell, axis=1))[::-1]
        if np.linalg.norm(u) <= -distance[8]:
            assert u == pytest.approx(reference(ell, b, 1e6), abs=1e-7)
