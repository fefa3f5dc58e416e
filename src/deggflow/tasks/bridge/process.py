"""The complete process: robots drive to the plank, build the bridge, cross it (paper, fig:task1_rollout)."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

Stage = Literal["approach", "build", "cross"]

TICK = 0.1  # s between two moments of a process


class Process(NamedTuple):
    """Where everything is, moment by moment, `TICK` apart; a trial in which a robot was lost ends without the crossing."""

    plank: Float[np.ndarray, "ticks 3"]  # x, y in m, theta in rad
    robots: Float[np.ndarray, "ticks robots 2"]  # m, centres
    stage: tuple[Stage, ...]  # of each tick
    robot_goals: Float[np.ndarray, "robots 2"]  # m
    plank_goal: Float[np.ndarray, " 3"]  # m, m, rad
    failure: str | None  # why it ended without the crossing
    lost: Mapping[int, int] = MappingProxyType({})  # robots that were lost, and from which tick on

    def lost_by(self, tick: int) -> list[int]:
        """Robots that were lost at a tick, or before."""
        return sorted(robot for robot, first in self.lost.items() if tick >= first)
