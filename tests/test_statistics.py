"""Confidence intervals of proportions, against SciPy's."""

import pytest
from scipy.stats import binomtest

from deggflow.statistics import Rate


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
@pytest.mark.parametrize(
    ("successes", "cases"), [(0, 1), (1, 1), (0, 200), (200, 200), (7, 9), (9_990, 10_000)]
)
def test_the_interval_is_wilsons(successes, cases, confidence):
    expected = binomtest(successes, cases).proportion_ci(confidence, method="wilson")
    assert Rate(successes, cases).interval(confidence) == (expected.low, expected.high)


def test_a_rate_is_printed_in_percent_with_its_interval():
    assert str(Rate(0, 20)) == "0.0% [0.0, 16.1]"
    assert str(Rate(9_990, 10_000)) == "99.90% [99.82, 99.95]"
