"""Examples in docstrings run, and print what they say."""

import doctest
import importlib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import deggflow
from deggflow import requirements

MODULES = (
    "guidance.allocation",
    "guidance.margins",
    "guidance.private",
    "sampling",
    "certification",
    "runtime.messages",
    "shards",
    "studio.showing",
)


def field(tau, z, condition):
    return -z


def far(z, condition):
    return deggflow.distances(z) - 0.3


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name):
    apart = deggflow.PrivateRequirement(far, 0.02, name="apart")
    known = {
        "jax": jax,
        "jnp": jnp,
        "field": field,
        "apart": apart,
        "guidance": deggflow.DecoupledGuidance((apart,)),
        "condition": None,
        "z0": jax.random.normal(jax.random.key(0), (5, 2)),
        **{public: getattr(deggflow, public) for public in deggflow.__all__},
    }
    module = importlib.import_module(f"deggflow.{name}")
    run(module, {**vars(module), **known})


NAMED = (
    "apart", "bodies", "equality", "grid", "layout", "logic", "modes", "motion", "placement", "regions", "smooth", "team",
    "values",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMED)
def test_examples_of_named_requirements_run(name):
    public = {each: getattr(requirements, each) for each in requirements.__all__}
    module = importlib.import_module(f"deggflow.requirements.{name}")
    run(module, {"jax": jax, "jnp": jnp, "np": np, **public, **vars(module)})


OTHERS = (
    "blocks", "deviation.least", "schema", "task.training", "tasks.fleet.crowding", "tasks.fleet.floor_files", "tasks.fleet.paths",
    "tasks.fleet.schemes", "tasks.fleet.ways", "train.store", "view.fleet.mjcf", "view.fleet.playback",
)  # fmt: skip
ELSEWHERE = (  # with what their examples take for granted
    "frames", "loggers", "plotting", "pretrained", "tables.columns", "torch",
)  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_examples_that_need_nothing_run(name):
    module = importlib.import_module(f"deggflow.{name}")
    run(module, {"jnp": jnp, "np": np, **vars(module)})


def test_no_example_is_left_out():
    root = Path(deggflow.__file__).parent
    modules = {
        ".".join(path.relative_to(root).with_suffix("").parts)
        for path in root.rglob("*.py")
        if ">>> " in path.read_text()
    }
    run_here = {*MODULES, *OTHERS, *(f"requirements.{name}" for name in NAMED)}
    assert modules == run_here | set(ELSEWHERE)


def run(module, known):
    tests = [test for test in doctest.DocTestFinder().find(module, globs=known) if test.examples]
    assert tests
    for test in tests:
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
        assert runner.run(test).failed == 0, test.name
