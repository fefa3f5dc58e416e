"""Compiled programs that are kept between calls are those of the guidance that is asked for."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from deggflow import EveryStep, PrivateRequirement, StepGuard, distances, refined_grid
from deggflow.guidance import DecoupledGuidance
from deggflow.sampler import Sampler, masked_batch

AGENTS = 3
GRID = refined_grid(6)


class Condition(NamedTuple):
    mask: np.ndarray


def together(tau, z, condition):
    return -2.0 * z


def guidance(metric=None):
    apart = PrivateRequirement(lambda z, condition: distances(z) - 0.5, 0.05, name="apart")
    return DecoupledGuidance((apart,), metric=metric)


def test_a_single_sample_is_generated_under_the_guidance_of_the_call():
    """Guidances of the same functions that differ in an array, or in whether there is one, take turns."""
    plain = guidance()
    stretched, turned = (
        eqx.tree_at(lambda g: g.metric, plain, jnp.asarray(metric), is_leaf=lambda x: x is None)
        for metric in (np.diag([1.0, 9.0]), np.array([[2.0, 1.0], [1.0, 3.0]]))
    )
    sampler = Sampler(together, GRID, StepGuard())
    rng = np.random.default_rng(0)
    z0 = rng.normal(size=(1, AGENTS, 2)).astype(np.float32)
    condition = Condition(np.ones((1, AGENTS), bool))
    program = eqx.filter_jit(masked_batch)
    ends = []
    for each in (plain, stretched, plain, turned, stretched):
        drawn = sampler.draw(each, z0, condition)
        wanted = program(
            together, each, jnp.asarray(z0), condition, GRID, EveryStep(), StepGuard(), False
        )
        np.testing.assert_allclose(drawn.z, wanted.z, rtol=1e-5, atol=1e-6)
        ends.append(drawn.z)
    for one, other in ((0, 1), (1, 3), (0, 3)):
        assert np.abs(ends[one] - ends[other]).max() > 1e-3
    np.testing.assert_array_equal(ends[0], ends[2])
    np.testing.assert_array_equal(ends[1], ends[4])
