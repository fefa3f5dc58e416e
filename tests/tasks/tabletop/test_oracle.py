"""Shapely's second opinion and the verdict agree, and false claims are refuted."""

import numpy as np
import pytest

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.oracle import TOLERANCE, least_margin, refutes
from deggflow.tasks.tabletop.verdict import judge

CUP_AND_LAMP = ("pen_cup", "desk_lamp")


@pytest.fixture(scope="module")
def many(random_scenes):
    conditions, poses = [], []
    for size in (1, 2, 3, 4, 6, 9):
        for k, family in enumerate(("default", "changed", "combined")):
            some = random_scenes(k, 16, size, family)
            conditions, poses = conditions + some[0], poses + some[1]
    return conditions, poses


def test_the_verdict_agrees(many, reference):
    """The same least margin where cores are apart, the same sign everywhere."""
    apart = 0
    for condition, pose, verdict in zip(*many, judge(*many), strict=True):
        opinion = least_margin(condition, pose)
        assert (opinion >= 0) == verdict.satisfied
        assert refutes(condition, pose) == (not verdict.satisfied)
        margins = reference(condition, pose)
        cores = np.concatenate([margins["separation of cores"], margins["unobstructed of cores"]])
        if np.all(cores > 0):
            apart += 1
            assert opinion == pytest.approx(verdict.min_margin, abs=1e-9)
        else:
            # Shapely knows no depth; it still sees that the cores meet.
            assert verdict.min_margin - 1e-9 <= opinion < 0
    assert 50 < apart < len(many[0])


def test_a_false_claim_is_refuted():
    condition = SceneCondition(CUP_AND_LAMP)
    good = np.array([(-0.3, 0.0, np.pi), (0.3, 0.0, 0.0)])
    assert not refutes(condition, good)
    for k, bad in (
        (1, (-0.3 + 0.034 + 0.06 - 1e-6, 0.0, 0.0)),  # into the cup
        (0, (0.3, -0.2, 0.0)),  # into the lamp's region
        (0, (-0.7 + 0.034 - 1e-6, 0.0, 0.0)),  # over the edge
        (0, (-0.7 + 0.122 - 1e-6, 0.0, np.pi)),  # its region over the edge
        (0, (np.nan, 0.0, 0.0)),
    ):
        poses = good.copy()
        poses[k] = bad
        assert refutes(condition, poses)


def test_touching_is_allowed():
    """Margins of zero hold; rounding of float64 refutes nobody."""
    condition = SceneCondition(CUP_AND_LAMP)
    touching = np.array([(-0.1, 0.0, np.pi), (-0.1 + 0.034 + 0.06, 0.0, 0.0)])
    assert abs(least_margin(condition, touching)) < TOLERANCE
    assert not refutes(condition, touching)
