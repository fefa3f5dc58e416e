"""Distances between nominal and guided samples by trying all permutations, and their intervals by leaving pairs out."""

from itertools import permutations

import numpy as np
import pytest
from scipy.stats import t

from deggflow.deviation import assignment, measure, squared_distances, wasserstein

AGENTS, DIM = 3, 2
SIZE = AGENTS * DIM


def matrices(nominal, guided):
    pairs = (nominal, guided), (nominal, nominal), (guided, guided)
    return [squared_distances(a, b) for a, b in pairs]


def best_of_all(cross):
    """Least mean of squared distances over all permutations, and where it is reached."""
    rows = np.arange(len(cross))
    return min((cross[rows, list(p)].mean(), p) for p in permutations(rows))


@pytest.mark.parametrize("seed", range(4))
def test_the_assignment_is_the_best_of_all_permutations(seed):
    rng = np.random.default_rng(seed)
    nominal, guided = rng.normal(size=(2, 6, AGENTS, DIM))
    cross, near, far = matrices(nominal, guided)
    for m in range(6):
        for n in range(6):
            assert cross[m, n] == pytest.approx(np.sum((nominal[m] - guided[n]) ** 2))
    least, where = best_of_all(cross)
    assert tuple(assignment(cross)) == where
    found = measure(cross, near, far)
    assert found.w2 == pytest.approx(np.sqrt(least)) == wasserstein(cross)
    assert found.paired == pytest.approx(np.sqrt(np.mean((nominal - guided) ** 2) * SIZE))
    assert found.identity == np.mean(np.array(where) == np.arange(6))


def test_figures_worked_out_by_hand():
    """Points 0, 1, 5 on a line; guidance takes 0 to 1 and 1 to 0, and 5 to 8."""
    nominal, guided = (np.array(points).reshape(3, 1, 1) for points in ([0.0, 1, 5], [1.0, 0, 8]))
    found = measure(*matrices(nominal, guided))
    assert found.w2 == pytest.approx(np.sqrt(9 / 3))  # the first two exchange their partners
    assert found.paired == pytest.approx(np.sqrt((1 + 1 + 9) / 3))
    assert found.identity == pytest.approx(1 / 3)
    assert found.spread == pytest.approx(np.sqrt((1 + 25 + 16) / 3))
    assert found.ratio == pytest.approx(np.sqrt(9 / 42))
    assert found.spread_ratio == pytest.approx(np.sqrt((1 + 64 + 49) / 42))


def test_a_shift_is_its_own_distance(key):
    nominal = np.random.default_rng(0).normal(size=(30, AGENTS, DIM))
    found = measure(*matrices(nominal, nominal + 0.3))
    assert found.w2 == pytest.approx(found.paired) == pytest.approx(0.3 * np.sqrt(SIZE))
    assert found.identity == 1
    np.testing.assert_allclose([found.spread_ratio, *found.spread_interval], 1.0)


def test_too_few_samples_are_refused():
    two = np.zeros((2, 2))
    with pytest.raises(ValueError, match="at least 3"):
        measure(two, two, two)


def left_out(nominal, guided, m):
    """Both ratios without pair m, assignment and all."""
    cross, near, far = matrices(*(np.delete(each, m, axis=0) for each in (nominal, guided)))
    return wasserstein(cross) / np.sqrt(near.sum()), np.sqrt(far.sum() / near.sum())


def jackknife(estimate, values):
    count = len(values)
    error = np.sqrt((count - 1) / count * np.sum((values - np.mean(values)) ** 2))
    reach = t(count - 1).ppf(0.975) * error / estimate
    return estimate * np.exp(np.array([-reach, reach]))


@pytest.mark.parametrize(("push", "always_own"), [(0.05, True), (1.5, False)])
def test_intervals_leave_out_one_pair_after_the_other(push, always_own):
    """Exactly where the assignment is the identity; else it is another one without a pair, and costs more."""
    rng = np.random.default_rng(3)
    nominal = rng.normal(size=(25, 2, 1))
    guided = nominal + push * rng.normal(size=nominal.shape) * (0.2 + (nominal > 0))
    found = measure(*matrices(nominal, guided))
    assert (found.identity == 1) == always_own
    ratio, spread_ratio = np.array([left_out(nominal, guided, m) for m in range(25)]).T
    ratio *= np.sqrt(24 * 23)
    np.testing.assert_allclose(found.spread_interval, jackknife(found.spread_ratio, spread_ratio))
    written_out = jackknife(found.ratio, ratio)
    np.testing.assert_allclose(found.ratio_interval, written_out, rtol=1e-9 if always_own else 0.1)


def test_one_sample_that_moved_gives_a_wide_interval():
    nominal = np.random.default_rng(0).normal(size=(20, 1, 3))
    guided = nominal.copy()
    found = measure(*matrices(nominal, guided))
    assert (found.ratio, *found.ratio_interval) == (0.0, 0.0, 0.0)
    guided[3] += 0.1
    low, high = measure(*matrices(nominal, guided)).ratio_interval
    assert high > 10 * low > 0


@pytest.mark.parametrize(("size", "push"), [(8, 0.3), (2, 1.0)])
def test_intervals_cover_the_expected_ratios(size, push):
    """Far apart in eight dimensions each keeps its own; in two the assignment is another one every time."""
    rng = np.random.default_rng(size)

    def sample():
        nominal = rng.normal(size=(40, 1, size))
        return measure(*matrices(nominal, nominal + push * rng.normal(size=nominal.shape)))

    others, found = [sample() for _ in range(600)], [sample() for _ in range(200)]
    assert (np.mean([one.identity for one in found]) > 0.99) == (size == 8)
    for value, interval in (("ratio", "ratio_interval"), ("spread_ratio", "spread_interval")):
        expected = np.mean([getattr(one, value) for one in others])
        low, high = np.array([getattr(one, interval) for one in found]).T
        assert 0.9 <= np.mean((low <= expected) & (expected <= high)) <= 0.985
