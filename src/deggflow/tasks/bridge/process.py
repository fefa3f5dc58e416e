"""The complete process: robots drive to the plank, build the bridge, cross it (paper, fig:task1_rollout)."""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

Stage = Literal["approach", "build", "cross"]

TICK = 0.1  # s between two moments of a process


class Process(NamedTuple):
    """Where everything is, moment by moment, `TICK` apart."""

    plank: Float[np.ndarray, "ticks 3"]  # x, y in m, theta in rad
    robots: Float[np.ndarray, "ticks robots 2"]  # m, centres
    stage: tuple[Stage, ...]  # of each tick
    robot_goals: Float[np.ndarray, "robots 2"]  # m
    plank_goal: Float[np.ndarray, " 3"]  # m, m, rad
    failure: str | None  # why it ended without the crossing
