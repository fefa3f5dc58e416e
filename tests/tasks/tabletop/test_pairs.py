"""Pairs of parts: every two once, values picked exactly and summed back."""

from itertools import combinations, product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.tabletop.pairs import between, pick, total, within


def test_each_pair_stands_there_once():
    assert list(zip(*within(5), strict=True)) == list(combinations(range(5), 2))
    assert list(zip(*between(3, 4), strict=True)) == list(product(range(3), range(4)))


@pytest.mark.parametrize("samples", [(), (7,), (2, 3)])
def test_picked_are_the_numbers_themselves(samples):
    parts = np.random.default_rng(0).normal(size=(6, *samples)).astype(np.float32)
    for index in within(6):
        np.testing.assert_array_equal(jax.jit(lambda x, k=index: pick(k, x))(parts), parts[index])


@pytest.mark.parametrize("samples", [(), (7,), (2, 3)])
def test_total_adds_up_what_belongs_to_each_part(samples):
    pairs = within(6)
    values = np.random.default_rng(1).normal(size=(len(pairs.first), *samples)).astype(np.float32)
    for index in pairs:
        wanted = np.zeros((6, *samples))
        np.add.at(wanted, index, values)
        np.testing.assert_allclose(total(index, jnp.asarray(values), 6), wanted, atol=1e-6)
