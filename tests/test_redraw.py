import pytest
from hypothesis import given
from hypothesis import strategies as st

from deggflow.blocks import BATCHES, padded_batch
from deggflow.redraw import Candidate, redraw_until_satisfied


@given(st.lists(st.lists(st.floats(-1, 1), min_size=4, max_size=4), min_size=1, max_size=6))
def test_the_first_satisfied_draw_is_kept_else_the_closest(table):
    asked = []

    def attempt(index, number):
        asked.extend((k, number) for k in index)
        return [Candidate((k, number), table[k][number] >= 0, table[k][number]) for k in index]

    kept = redraw_until_satisfied(attempt, len(table), 4)
    for k, (row, candidate) in enumerate(zip(table, kept, strict=True)):
        good = [number for number, margin in enumerate(row) if margin >= 0]
        number = good[0] if good else row.index(max(row))
        assert candidate.sample == (k, number)
        assert candidate.satisfied == bool(good)
        assert candidate.draws == (good[0] + 1 if good else 4)
        assert sum(1 for pair in asked if pair[0] == k) == candidate.draws


def test_at_least_one_draw():
    with pytest.raises(ValueError, match="`max_draws` must be at least 1; got 0"):
        redraw_until_satisfied(lambda index, number: [], 1, 0)


@given(st.integers(1, 2000))
def test_batches_hold_what_they_are_asked_to(samples):
    size = padded_batch(samples)
    assert size in BATCHES
    assert size >= min(samples, max(BATCHES))
