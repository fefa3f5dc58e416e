"""What the local QP takes as a metric, a limit and rows; anything else is refused by name."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.guidance import min_norm_input
from deggflow.guidance.metric import check_metric
from deggflow.guidance.qp import check_limits


@pytest.mark.parametrize("limit", ["box", "norm"])
def test_limits_must_be_positive(limit):
    with pytest.raises(ValueError, match=f"`{limit}` must be positive"):
        min_norm_input(jnp.ones((1, 2)), jnp.ones(1), **{limit: 0.0})


def test_metrics_that_are_fine():
    for metric in (
        None,
        np.eye(2),
        jnp.eye(3, dtype=jnp.float32),
        np.stack([np.eye(2), 2 * np.eye(2)]),
        np.diag([1e-20, 1e20]),  # inputs of different units
        np.array([[2.0, 1.0], [1.0 + 1e-7, 2.0]]),  # rounding
    ):
        check_metric(metric)
    jax.jit(lambda metric: check_metric(metric) or metric)(-jnp.eye(2))  # not known yet


@pytest.mark.parametrize(
    ("metric", "error", "message"),
    [
        ([[1.0]], TypeError, "`metric` must be an array"),
        (np.eye(2, dtype=int), TypeError, "`metric` must hold floating-point numbers; got int"),
        (np.ones(3), ValueError, r"`metric` must have shape \(inputs, inputs\).*got \(3,\)"),
        (np.ones((2, 3)), ValueError, r"`metric` must have shape .*got \(2, 3\)"),
        (np.array([[1.0, 2.0], [0.0, 1.0]]), ValueError, r"symmetric; got 2 at \(0, 1\) and 0 at"),
        (np.ones((2, 2)), ValueError, "positive definite; got a matrix whose least eigenvalue is"),
        (np.stack([np.eye(2), -np.eye(2)]), ValueError, "of agent 1 must be positive definite; got -1"),
        (np.full((2, 2), np.nan), ValueError, "`metric` must be finite"),
    ],
)  # fmt: skip
def test_metrics_that_are_refused(metric, error, message):
    with pytest.raises(error, match=message):
        check_metric(metric)


def test_a_metric_must_fit_the_inputs():
    check_metric(np.eye(3), 3)
    with pytest.raises(ValueError, match=r"`metric` must have shape \(3, 3\).*got \(2, 2\)"):
        check_metric(np.eye(2), 3)


def test_a_metric_is_looked_at_by_the_qp_too():
    with pytest.raises(ValueError, match="`metric` must be positive definite"):
        min_norm_input(jnp.ones((1, 2)), jnp.ones(1), -jnp.eye(2))


@pytest.mark.parametrize("limit", ["box", "norm"])
@pytest.mark.parametrize(
    ("value", "error"),
    [(0.0, ValueError), (-1.0, ValueError), (float("nan"), ValueError), ("1", TypeError)],
)
def test_limits_are_positive_numbers(limit, value, error):
    """Called without the type checker of the tests, which would be the first to complain."""
    limits = {"box": None, "norm": None} | {limit: value}
    with pytest.raises(error, match=rf"`{limit}` must be .*; got '?{value}"):
        getattr(check_limits, "__wrapped__", check_limits)(**limits)


WRONG = """
import jax.numpy as jnp
from deggflow.guidance import min_norm_input

one, rows = jnp.ones(1), jnp.ones((1, 2))
for arguments in (
    (jnp.ones(2), one), (rows, jnp.ones(2)), (rows, jnp.ones((1, 1))), (rows, one, jnp.eye(3)),
    (rows, one, jnp.eye(2)[None]), (jnp.ones((1, 2), int), one), ([[1.0, 2.0]], one), (rows, [1.0]),
):
    try:
        min_norm_input(*arguments)
    except (TypeError, ValueError) as error:
        print(type(error).__name__, error)
    else:
        print("nothing")
"""


def test_arguments_that_do_not_fit_are_named():
    """In a process of its own: here the type checker would be the first to complain."""
    run = subprocess.run([sys.executable, "-c", WRONG], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == [
        "ValueError `ell` must have shape (rows, inputs), one row per requirement; got (2,).",
        "ValueError `b` must have shape (1,), one number per row of `ell`; got (2,).",
        "ValueError `b` must have shape (1,), one number per row of `ell`; got (1, 1).",
        "ValueError `metric` must have shape (2, 2), or (agents, 2, 2) with one matrix per agent; got (3, 3).",
        "ValueError `metric` must be the one matrix of this agent, of shape (2, 2); got (1, 2, 2).",
        "TypeError `ell` must be an array of floating-point numbers, of shape (rows, inputs); got one of int32.",
        "TypeError `ell` must be an array of floating-point numbers, of shape (rows, inputs); got list.",
        "TypeError `b` must be an array of floating-point numbers, of shape (rows,); got list.",
    ]
