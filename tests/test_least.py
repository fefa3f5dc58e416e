"""The least sum of squares by a general solver and over all matchings; limits by simulation."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from deggflow.deviation import Cuts, least_square_sum, lower_confidence


def random_cuts(seed, agents, count):
    rng = np.random.default_rng(seed)
    pairs = np.array(list(combinations(range(agents), 2)))
    chosen = pairs[rng.choice(len(pairs), count)]
    return Cuts(chosen, rng.uniform(0.3, 2.0, (count, 2)), rng.uniform(0.01, 1.0, count))


def matrix(cuts, agents):
    rows = np.zeros((len(cuts.least), agents))
    for row, pair, weights in zip(rows, cuts.agents, cuts.weights, strict=True):
        for agent, weight in zip(pair, weights, strict=True):
            row[agent] += weight
    return rows


def matchings(edges):
    """Every set of edges that share no agent."""
    if not edges:
        return [[]]
    (pair, value), rest = edges[0], edges[1:]
    without = matchings(rest)
    compatible = [edge for edge in rest if not set(edge[0]) & set(pair)]
    return without + [[(pair, value), *each] for each in matchings(compatible)]


@given(st.integers(0, 10**6), st.integers(2, 6), st.integers(1, 9))
def test_it_is_the_least_sum_of_squares(seed, agents, count):
    cuts = random_cuts(seed, agents, count)
    rows = matrix(cuts, agents)
    found = least_square_sum(cuts, agents)
    solved = minimize(
        lambda e: e @ e, np.full(agents, 4.0), jac=lambda e: 2 * e, method="SLSQP",
        constraints={"type": "ineq", "fun": lambda e: rows @ e - cuts.least, "jac": lambda e: rows},
        options={"maxiter": 500, "ftol": 1e-13},
    )  # fmt: skip
    assert np.all(rows @ solved.x >= cuts.least - 1e-7)
    assert found == pytest.approx(solved.fun, abs=1e-6)


@given(st.integers(0, 10**6), st.integers(2, 6), st.integers(1, 8))
def test_no_matching_gives_more(seed, agents, count):
    """A pair alone: the foot of the perpendicular onto its line. Pairs without a common agent add up."""
    cuts = random_cuts(seed, agents, count)
    alone = cuts.least**2 / np.sum(cuts.weights**2, axis=1)
    edges = [(tuple(pair), value) for pair, value in zip(cuts.agents.tolist(), alone, strict=True)]
    best = max(sum(value for _, value in chosen) for chosen in matchings(edges))
    assert least_square_sum(cuts, agents) >= best - 1e-12


@given(st.integers(0, 10**6), st.integers(2, 6), st.integers(1, 9))
def test_no_distances_that_satisfy_the_cuts_have_a_smaller_sum(seed, agents, count):
    cuts = random_cuts(seed, agents, count)
    rows, rng = matrix(cuts, agents), np.random.default_rng(seed)
    trials = rng.exponential(size=(200, agents))
    trials *= np.max(
        cuts.least / (trials @ rows.T), axis=1, keepdims=True
    )  # just as large as needed
    assert np.all(np.sum(trials**2, axis=1) >= least_square_sum(cuts, agents) - 1e-12)


def test_agents_at_a_wall_and_no_cuts():
    walls = Cuts(np.array([[0, 0], [2, 2]]), np.array([[1.0, 0.0]] * 2), np.array([0.3, 0.4]))
    assert least_square_sum(walls, 3) == pytest.approx(0.25)
    none = Cuts(np.zeros((0, 2), int), np.zeros((0, 2)), np.zeros(0))
    assert least_square_sum(none, 3) == 0.0


@pytest.mark.parametrize("shape", [1.0, 0.3])
def test_a_limit_lies_below_as_often_as_it_says(shape):
    """Squares with a long tail, of which two thirds are zero: no more than one limit in twenty is too large."""
    rng = np.random.default_rng(1)
    squares = rng.gamma(shape, size=(2000, 256)) * (rng.uniform(size=(2000, 256)) < 1 / 3)
    below = [lower_confidence(each) <= np.sqrt(shape / 3) for each in squares]
    assert np.mean(below) >= 0.95


def test_a_limit_needs_two_squares():
    with pytest.raises(ValueError, match="at least 2"):
        lower_confidence(np.ones(1))
