"""What is said of conditions whose first draw fails."""

import fleet_feasibility
import numpy as np

from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.verdict import judge


def test_the_first_plan_that_the_verdict_accepts_proves_feasibility():
    (condition,) = random_conditions(2, 1, "empty", "random", seed=1)
    straight = np.linspace(condition.starts, condition.goals, 64, axis=1)
    jump = straight.copy()
    jump[:, 30] += 0.5
    assert judge([condition], [straight])[0].satisfied
    assert fleet_feasibility.first_good(condition, [jump, jump, straight]) == 3
    assert fleet_feasibility.first_good(condition, [jump]) is None


def test_a_way_straight_ahead_is_as_long_as_the_line():
    condition = FleetCondition("dense", (Robot((-0.2, -0.9), (-0.2, -0.7)),), speed_limit=0.05)
    share = fleet_feasibility.tightness(condition, 0, seed=1)
    assert 0.2 <= share * 63 * 0.05 < 0.25


def still(tau, z, condition):
    """A field whose paths are those of z(0)."""
    return -0.9 * z


def test_what_is_impossible_is_not_called_feasible():
    near = Robot((0.0, 0.0), (0.5, 0.0)), Robot((0.05, 0.0), (0.0, 0.5))
    impossible = FleetCondition("empty", near)
    (possible,) = random_conditions(2, 1, "empty", "random", seed=1)
    settings = fleet_feasibility.Settings(draws=1, teams=1, samples=2)
    ways = fleet_feasibility.Ways(settings, still)
    (failure,) = ways.failures([possible, impossible], seed=1)
    assert (failure.number, failure.miss.kind, failure.blocked) == (1, "apart", 2)
    assert failure.miss.margin <= 0.05 - 0.105
    assert not failure.feasible
    assert failure._replace(teams=1).feasible
