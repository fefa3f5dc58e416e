"""Neighbour lists against SciPy's tree: who is near, once and for all cells, and a list that is too short says so."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from deggflow.neighbours import find_neighbours

SLOTS = 24


@partial(jax.jit, static_argnums=4)
def found(points, targets, present, radius, slots):
    return find_neighbours(points, targets, present, radius, slots)


def lists(result):
    who, near = np.asarray(result.who), np.asarray(result.near)  # JAX would compile each length
    return [set(row[close].tolist()) for row, close in zip(who, near, strict=True)]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 2.0), st.sampled_from([0.5, 5.0, 400.0]))
def test_the_list_is_that_of_a_tree(seed, radius, size):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-size, size, (60, 2)).astype(np.float32)
    targets = rng.uniform(-size, size, (90, 2)).astype(np.float32)
    present = rng.random(90) < 0.8
    result = found(points, targets, present, jnp.float32(radius), 90)
    tree = KDTree(targets[present])
    names = np.flatnonzero(present)
    gaps = np.linalg.norm(points[:, None] - targets[names][None], axis=-1)
    if np.abs(gaps - radius).min() < 1e-5 * size:
        return  # whether this pair is near is for rounding to say
    wanted = [set(names[near].tolist()) for near in tree.query_ball_point(points, radius)]
    assert lists(result) == wanted
    assert not result.missed


def test_the_nearest_come_first():
    targets = jnp.array([[0.3, 0.0], [0.1, 0.0], [0.2, 0.0], [5.0, 0.0]])
    result = found(jnp.zeros((1, 2)), targets, jnp.ones(4, bool), jnp.float32(1.0), 4)
    assert result.who[0][result.near[0]].tolist() == [1, 2, 0]


@pytest.mark.parametrize(("count", "missed"), [(SLOTS, False), (SLOTS + 1, True)])
def test_too_many_neighbours_are_told(count, missed):
    targets = jnp.linspace(0.0, 0.1, count)[:, None] * jnp.ones((1, 2))
    result = found(jnp.zeros((1, 2)), targets, jnp.ones(count, bool), jnp.float32(1.0), SLOTS)
    assert bool(result.missed) is missed


def test_a_point_that_is_not_a_number_is_told():
    points = jnp.array([[jnp.nan, 0.0]])
    assert found(points, jnp.zeros((1, 2)), jnp.ones(1, bool), jnp.float32(1.0), 4).missed


def test_who_does_not_count_takes_no_slot():
    points = jnp.zeros((4, 2))
    result = find_neighbours(
        points, points, jnp.ones(4, bool), jnp.asarray(1.0), 4,
        lambda found: found > jnp.arange(4)[:, None],
    )  # fmt: skip
    assert lists(result) == [{1, 2, 3}, {2, 3}, {3}, set()]
    assert not result.missed
