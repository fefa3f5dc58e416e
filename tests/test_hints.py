"""Advice on slow use: given once, where it applies."""

import warnings
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import NoGuidance, generate, hints, refined_grid


@pytest.fixture(autouse=True)
def forgotten():
    hints._calls.clear()
    yield
    hints._calls.clear()


def field(tau, z, condition):
    return -z


run = partial(generate, grid=refined_grid(2))
Z0 = jnp.ones((2, 1))


@pytest.mark.filterwarnings("default:`generate")
def test_a_third_call_without_jit_is_remarked_on_once():
    with warnings.catch_warnings(record=True) as given:
        for _ in range(5):
            run(field, NoGuidance(), Z0, None)
    [warning] = given
    assert "equinox.filter_jit(generate)" in str(warning.message)


@pytest.mark.filterwarnings("error:`generate")
def test_compiled_calls_and_few_calls_are_not():
    compiled = eqx.filter_jit(run)
    results = [compiled(field, NoGuidance(), Z0, None).z for _ in range(5)]
    jax.vmap(lambda z0: run(field, NoGuidance(), z0, None).z)(jnp.ones((3, 2, 1)))
    for agents in (2, 2, 3, 3):
        run(field, NoGuidance(), jnp.ones((agents, 1)), None)
    # Nor is a program whose z(0) is a constant, however often it is traced.
    for _ in range(3):
        jax.jit(lambda: run(field, NoGuidance(), Z0, None).z)()
    np.testing.assert_array_equal(results[0], results[4])
