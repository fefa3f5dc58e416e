"""Plans beside others' own code: MRMP's check as its loops have it, and rows that are theirs."""

import fleet_published
import numpy as np

from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.maps import NAMED
from deggflow.tasks.fleet.paths import exact_path
from deggflow.tasks.fleet.verdict import judge


def mrmp(condition, paths):
    """As `check_paths_ok` of RAISELab-atUVA/Diffusion-MRMP goes through robots, obstacles and times."""
    radius, tolerance = condition.radius, 1e-3
    for k, path in enumerate(paths):
        for x, y, size in condition.floor.discs:
            for point in path:
                if (point[0] - x) ** 2 + (point[1] - y) ** 2 < (radius + size) ** 2 - tolerance:
                    return False
        for other in paths[k + 1 :]:
            for a, b in zip(path, other, strict=True):
                if (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 < (2 * radius) ** 2 - tolerance:
                    return False
    return True


def test_mrmps_check_is_that_of_its_loops_and_weaker_than_the_verdict():
    rng, passed = np.random.default_rng(2), []
    for condition in random_conditions(3, 60, "dense", "random", seed=4):
        z = 0.3 * rng.normal(size=(3, 124))
        paths = exact_path(z, condition.starts, condition.goals)
        passed.append(fleet_published.passes_mrmp(condition, paths))
        assert passed[-1] == mrmp(condition, paths)
        (verdict,) = judge([condition], [paths])
        assert passed[-1] or not verdict.satisfied
    assert 0 < sum(passed) < 60


def test_boxes_count_for_mrmps_check_too():
    x, y, _, height = NAMED["conveyor"].boxes[0]
    above = y + height / 2 + 0.05
    robot = Robot((x, above), (x, above))
    condition = FleetCondition("conveyor", (robot,))
    assert fleet_published.passes_mrmp(condition, np.full((1, 64, 2), (x, above)))
    assert not fleet_published.passes_mrmp(condition, np.full((1, 64, 2), (x, above - 0.02)))


def test_rows_of_others_are_marked_and_have_their_own_trials():
    (row,) = fleet_published.theirs("conveyor", 6)
    assert row[:3] == ("conveyor", "6", "theirs: MMD's code, prioritised")
    assert row[4:] == ("0/5", "0.0% [0.0, 43.4], own check", "9 to 29 s")
    assert not fleet_published.theirs("conveyor", 9)
    assert len(row) == len(fleet_published.HEAD)
