"""Where pictures of a process are taken: a MuJoCo model whose bodies are moved, or a top view."""

import numpy as np

from deggflow.tasks.bridge.process import Process
from deggflow.view.colours import FAULT, rgb
from deggflow.view.picture import Picture
from deggflow.view.stage import MovableModel, Shot, Stage, open_stage

from .mjcf import PLANK, bridge_mjcf, robot_name
from .moment import Moment
from .parts import LOST

_TINT = 0.72  # how red what is at fault becomes, and how pale who was lost


class BridgeModel(MovableModel[Moment]):
    """Plank and robots of one process, to be moved and reddened."""

    def __init__(self, process: Process, aspect: float) -> None:
        super().__init__(bridge_mjcf(process.robot_goals, process.plank_goal, aspect=aspect))
        self._colours = self.model.geom_rgba.copy()
        self._robots = [robot_name(i) for i in range(len(process.robot_goals))]

    def place(self, state: Moment) -> None:
        """Moves plank and robots; reddens what is at fault, and pales who was lost."""
        x, y, theta = state.plank
        self.move(PLANK, x, y, theta=theta)
        for name, place in zip(self._robots, state.robots, strict=True):
            self.move(name, *place)
        self._tint(PLANK, FAULT if state.red_plank else None)
        for name, red, lost in zip(self._robots, state.red_robots, state.lost_robots, strict=True):
            self._tint(name, FAULT if red else LOST if lost else None)

    def _tint(self, name: str, colour: str | None) -> None:
        """Tints a body's geoms, but not its shadow."""
        owned = self.model.geom_bodyid == self.model.body(name).id
        geoms = np.flatnonzero(owned & (self._colours[:, 3] == 1.0))
        plain = self._colours[geoms, :3]
        tint = 0.0 if colour is None else _TINT * (np.array(rgb(colour)) - plain)
        self.model.geom_rgba[geoms, :3] = plain + tint


def bridge_stage(process: Process, shot: Shot) -> Stage[Moment]:
    """A stage for one process.

    Raises:
        ValueError: If the process has no ticks, or its parts do not fit together.
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    _check(process)

    def draw(state: Moment, width: int, height: int) -> Picture:
        from .topview import topview_image  # brings matplotlib, which MuJoCo's pictures do without

        return topview_image(state, process.robot_goals, process.plank_goal, width, height)

    return open_stage(lambda: BridgeModel(process, shot.width / shot.height), draw, shot)


def _check(process: Process) -> None:
    ticks, robots = len(process.stage), len(process.robot_goals)
    if ticks == 0:
        raise ValueError("`process` must have at least one tick to be drawn; got none.")
    if process.plank.shape != (ticks, 3) or process.robots.shape != (ticks, robots, 2):
        raise ValueError(
            f"`process` must hold {ticks} plank poses and {ticks} places of {robots} robots, one "
            f"per tick and goal; got shapes {process.plank.shape} and {process.robots.shape}."
        )
