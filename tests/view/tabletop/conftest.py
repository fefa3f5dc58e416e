"""Scenes to take pictures of."""

import numpy as np
import pytest

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.library import NAMES


@pytest.fixture
def everything():
    """All twelve objects in rows, turned in all directions."""
    poses = [(0.34 * (i % 4) - 0.5, 0.3 - 0.3 * (i // 4), 0.7 * i) for i in range(len(NAMES))]
    return SceneCondition(NAMES), np.array(poses)


@pytest.fixture
def trio():
    """A laptop, a mug and a pen cup; poses without a breach."""
    poses = np.array([[-0.2, 0.0, 0.0], [0.3, 0.2, 0.5], [0.3, -0.2, 0.0]])
    return SceneCondition(("laptop", "handled_mug", "pen_cup")), poses


@pytest.fixture
def trio_blocked(trio):
    """The same objects: the mug's body in the laptop's region, the pen cup in the mug."""
    condition, poses = trio
    poses = poses.copy()
    poses[1] = -0.2 + 0.155, 0.0, 0.0
    poses[2] = -0.2 + 0.155 + 0.09, 0.0, 0.0
    return condition, poses
