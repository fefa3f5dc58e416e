"""Everything is checked where it enters: errors name the argument, what it should be and what it got."""

import json
import os
import re
import subprocess
import sys
from functools import cache

import argument_cases
import pytest
from argument_cases import CASES

EXPECTED = {
    "boolean margins": "TypeError: `margins` of 'apart' must be signed floating-point .* got bool",
    "integer margins": "TypeError: `margins` of 'apart' must be signed floating-point .* got int32",
    "margins without columns": r"ValueError: `margins` of 'apart' must have shape .* got \(3,\)",
    "transposed margins": r"ValueError: `margins` .* for each of 3 agents; got \(7, 3\)",
    "margins that are no function": "TypeError: `margins` must be a function .* got 0.3",
    "negative buffer": "ValueError: `buffer` must be a nonnegative .* got -0.02",
    "buffer that is not a number": "ValueError: `buffer` must be a nonnegative .* got nan",
    "negative buffer of a factor": "ValueError: `buffer` must be a nonnegative .* got -1.0",
    "margins that are rounded": "TypeError: `margins` of 'apart' are float32 for states of float64",
    "boolean value": "TypeError: `value` of 'left' must be a floating-point .* got bool",
    "value for each agent": r"ValueError: `value` of 'left' must have shape \(\), .* got \(3,\)",
    "profile that does not end": "ValueError: `profile` must fall from 1 .* got 1.0 and 0.5",
    "end that is no function": "TypeError: `end` must be a function of the condition.* got 0.5",
    "factors that are no tuple": "TypeError: `factors` must be a tuple .* got SharedFactor",
    "one requirement": "TypeError: `requirements` must be a tuple; got one .*`\\(requirement,\\)`",
    "a list of requirements": r"TypeError: `requirements` must be a tuple .* got \[Private",
    "two of one name": "ValueError: `requirements` must have names .* got 'apart' 2 times",
    "metric that is not positive": "ValueError: `metric` must be positive definite; got -1",
    "metric that is not symmetric": "ValueError: `metric` must be symmetric; got 0.5 at",
    "metric of another size": r"ValueError: `metric` must have shape \(2, 2\).* got \(3, 3\)",
    "box of zero": "ValueError: `box` must be positive.* got 0.0",
    "box for each input": r"TypeError: `box` must be a number.* got \(1.0, 1.0\)",
    "control of one matrix": r"ValueError: `control` must .* \(3, 2, inputs\), or diagonals \(3, 2\); got \(2, 2\)",
    "control that is no function": "TypeError: `control` must be a function .* got ArrayImpl",
    "integer z0": "TypeError: `z0` must be a floating-point .* got int32",
    "flat z0": r"ValueError: `z0` must have shape \(agents, dim\); got \(6,\)\.$",
    "a batch of z0": r"ValueError: `z0` .* got \(4, 3, 2\). `generate_batch` takes a batch",
    "z0 of one sample": r"ValueError: `z0` .* got \(3, 2\). `generate` takes one sample",
    "field that would be broadcast": r"ValueError: `field` .* \(3, 2\); got \(2,\)",
    "integer field": "TypeError: `field` must return a floating-point array.* got int32",
    "field that returns a number": "TypeError: `field` must return .* got float",
    "grid that ends early": "ValueError: `grid` must go from 0 to 1; got 0 to 0.02",
    "grid that is reversed": "ValueError: `grid` must increase; got 1 before 0.9 at point 1",
    "grid that goes back": "ValueError: `grid` must increase; got 0.6 before 0.4 at point 2",
    "grid that begins late": "ValueError: `grid` must go from 0 to 1; got 0.1 to 1",
    "grid of one point": r"ValueError: `grid` must be at least two values .* shape \(1,\)",
    "grid with not a number": "ValueError: `grid` must increase; got 0 before nan at point 1",
    "mask of numbers": "TypeError: `mask` must be boolean, .* got float64",
    "mask of another size": r"ValueError: `mask` must have shape \(3,\).* got \(4,\)",
    "stops of another size": r"ValueError: `stops` must have shape \(3,\).* got \(4,\)",
    "condition without samples": r"ValueError: .* of 4 samples; got shape \(\) at condition\['speed'\]",
    "condition of agents": r"ValueError: .* of 4 samples; got shape \(3, 2\) at condition\['goal'\]",
    "certify a batch": r"ValueError: `sample` must be one .* got \(4, 3, 2\): use `certify_batch`",
    "certify an array": "TypeError: `sample` must be a `Generation` .* got ArrayImpl",
    "certify_batch of one": r"ValueError: `samples` must be a batch .* got \(3, 2\)",
    "certify with one requirement": "TypeError: `requirements` must be a tuple; got one",
    "certify without agents": "ValueError: `mask` must leave some agent present; got none",
    "trajectory of text": "TypeError: `tau` of a trajectory must be real numbers; got <U1",
    "no samples": "ValueError: `count` must be a positive number of samples; got 0",
    "shape of numbers": r"ValueError: `shape` must be \(agents, dim\) of a state; got \(3,\)",
    "both conditions": "ValueError: `condition` is one for all .* pass one of the two",
    "conditions of another count": r"ValueError: every leaf of `conditions` .* got shape \(3,\)",
    "mask and masks": "ValueError: `mask` is one for all .* pass one of the two",
    "no draws": "ValueError: `max_draws` must be at least 1; got 0",
    "z(0) of another shape": r"ValueError: `initial` must .* \(3, 2\); got \(2, 2\)",
    "key that is a number": "TypeError: `key` must be a key of JAX, such as .*; got 0",
    "condition with text": r"TypeError: every leaf of `condition` .* got 'kitchen' at condition\['name'\]",
    "solver by name": "TypeError: `solver` must be `EULER`, .* got 'euler'",
    "drift by name": r"TypeError: `drift` must be `EveryStep\(\)`, .* got 'held'",
    "guard that is a number": r"TypeError: `guard` must be `StepGuard\(\)`, .* got 3",
    "no guidance": "TypeError: `requirements` must be a tuple .*",
    "formula that is a region": "TypeError: `inner` must be a formula",
    "formulas of which one is a region": "TypeError: `other` must be a formula",
    "window of one waypoint": r"ValueError: `window` must be a first and a last waypoint.* got 2",
    "radii of a formula": "ValueError: `radius` must be one number, of all agents; got array",
    "union of text": r"TypeError: `regions` must be a tuple of `Disc`.* got \('a',\)",
    "region of one axis": "ValueError: regions must have as many axes as positions, 2; got 1",
    "region in space": "ValueError: regions must have as many axes as positions, 2; got 3",
    "numbers of NumPy": None,
    "a good call": None,
}


@cache
def outcomes():
    """What plain Python says of every case, in one process."""
    done = subprocess.run(
        [sys.executable, "-W", "error", argument_cases.__file__],
        env={**os.environ, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_every_case_is_expected():
    assert CASES.keys() == EXPECTED.keys()


@pytest.mark.parametrize("name", EXPECTED)
def test_a_wrong_argument_is_named(name):
    found, wanted = outcomes()[name], EXPECTED[name]
    if wanted is None:
        assert found is None
        return
    assert found is not None, "nothing was raised"
    text = ": ".join(found)
    assert re.match(wanted, text), text
    assert "\n" not in text
