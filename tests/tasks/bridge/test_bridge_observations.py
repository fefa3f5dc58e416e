"""What robots read in numpy is what the field is trained on, and so are the factors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.tasks.bridge import factors
from deggflow.tasks.bridge.condition import BridgeCondition, Scales, observe
from deggflow.tasks.bridge.observations import Observations, safe_value, task_value
from deggflow.tasks.bridge.scenes import random_condition

SIZES = (2, 4, 5, 8)


def random_scales(rng):
    return Scales(
        eta=tuple(rng.uniform(0.1, 0.3, 24).tolist()),
        continuation_mean=tuple(rng.normal(0, 0.1, 40).tolist()),
        continuation_std=tuple(rng.uniform(0.1, 0.4, 40).tolist()),
    )


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(SIZES), st.integers(0, 2**32 - 1))
def test_readings_are_those_that_the_field_is_trained_on(robots, seed):
    """Anywhere in the workspace: on both grounds and between, beyond full turns."""
    rng = np.random.default_rng(seed)
    scales, condition = random_scales(rng), random_condition(robots, rng)
    pose, goal = rng.uniform([-7, -3, -7], [6.8, 3, 7]), rng.uniform([-7, -3, -7], [6.8, 3, 7])
    twist, ahead = rng.normal(size=3), rng.normal(size=(20, 3))
    contacts = np.array(condition.contacts)
    rows = Observations(contacts, goal, scales)(pose, twist, ahead)
    with jax.enable_x64(True):
        leaves = pose, twist, goal, contacts, np.ones(robots, bool), ahead
        seen = observe(BridgeCondition(*(jnp.asarray(leaf) for leaf in leaves)), scales)
        own, other, contact = (np.asarray(leaf, np.float64) for leaf in seen)
    for i in range(robots):
        pairs = [other[i, j] for j in range(robots) if j != i]
        expected = np.concatenate([own[i], *pairs, contact[i]])
        np.testing.assert_allclose(rows[i], expected, rtol=0, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_factors_are_those_of_the_guidance(seed):
    rng = np.random.default_rng(seed)
    contacts = np.array(random_condition(4, rng).contacts)
    pose = rng.uniform([-7, -3, -7], [6.8, 3, 7])
    observations = Observations(contacts, pose, Scales())
    with jax.enable_x64(True):
        task = factors.task_factor(jnp.asarray(pose))
        centres, mask = jnp.asarray(observations.centres), jnp.ones(4, bool)
        safe = factors.safe_factor(jnp.asarray(pose)[None], centres, mask)
    assert task_value(pose) == pytest.approx(float(task), abs=1e-10)
    assert safe_value(pose, observations.places(pose)) == pytest.approx(float(safe), abs=1e-10)
