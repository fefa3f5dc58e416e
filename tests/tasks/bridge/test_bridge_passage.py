"""Between the poses that are looked at nothing slips through."""

import numpy as np
import pytest

from deggflow.tasks.bridge.oracle import judge, replay
from deggflow.tasks.bridge.verdict import execute, integrate, margins, sub_poses
from deggflow.tasks.bridge.world import (
    DT,
    GAP_LEFT,
    PLANK_LENGTH,
    PLANK_WIDTH,
    SUPPORT,
    X_MIN,
)

CONTACTS = ((-2.4, 0.36), (-1.4, -0.36), (-0.9, 0.36))
# Found among policies from hard states: the plank's corner turns 15 micrometres over the workspace's left end and
# back, between two of the four poses that are looked at in each action.
PLANK = (-4.181707633197778, -0.020692966106056865, 0.5217353405146581)
TWISTS = np.array(
    [
        [0.04865642, 0.16742603, -0.25703952],
        [0.09542548, 0.17313315, -0.23802245],
        [0.16068088, 0.18922229, -0.22012398],
        [0.22914133, 0.20717051, -0.20047971],
    ]
)


def clearances(plank, twists, parts):
    """Least margin at each of many poses of the last action."""
    poses = integrate(np.array(plank), twists)
    return margins(sub_poses(poses[:-1], twists, parts), CONTACTS).least()


def test_an_arc_that_dips_between_two_poses_is_found():
    coarse, fine = clearances(PLANK, TWISTS, 4), clearances(PLANK, TWISTS, 4096)
    assert coarse.min() > 0 > fine.min()  # what makes the case hard
    verdict = execute(np.array(PLANK), TWISTS, CONTACTS)
    assert verdict.reason == "the plank leaves the workspace"
    assert verdict.margin == pytest.approx(fine.min(), abs=1e-8)


def test_shapely_finds_it_too():
    condition = {"plank": dict(zip(("x", "y", "theta"), PLANK, strict=True)), "contacts": CONTACTS}
    value = {"condition": condition, "twists": TWISTS.tolist(), "dt": DT}
    assert judge(value, replay(value)).least.min() < 0


@pytest.mark.parametrize("spare", [2e-5, 1e-3, 0.05])
def test_a_way_with_that_much_to_spare_is_free(spare):
    moved = (PLANK[0] + spare, *PLANK[1:])
    verdict = execute(np.array(moved), TWISTS, CONTACTS)
    assert verdict.reason is None
    assert verdict.margin == pytest.approx(clearances(moved, TWISTS, 4096).min(), abs=1e-4)
    assert moved[0] > X_MIN


def test_support_that_passes_over_the_gap_between_two_poses_is_found():
    """Steep enough, the plank reaches from neither ground to the other: for a moment nothing carries it."""
    theta, speed, contacts = 1.1372, 0.4, ((-2.65, 0.36), (-2.27, 0.36))
    reach = (PLANK_LENGTH * np.cos(theta) + PLANK_WIDTH * np.sin(theta)) / 2
    pose = np.array([GAP_LEFT - SUPPORT + reach - 0.005, 0.0, theta])  # 5 mm more than is needed
    twist = speed * np.array([[np.cos(theta), -np.sin(theta), 0.0]])  # along x
    ends = margins(np.concatenate([pose[None], sub_poses(pose[None], twist, 4)[0]]), contacts)
    assert ends.least().min() > 0
    assert execute(pose, twist, contacts).reason == "the plank loses its support"
