"""Where pictures of a process are taken: a MuJoCo model whose bodies are moved, or a top view."""

import math
from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Int, UInt8

from deggflow.tasks.bridge.process import Process
from deggflow.view.stage import Camera, Offscreen, RendererName, import_mujoco, mujoco_draws

from .mjcf import PLANK, bridge_mjcf, robot_name
from .moment import Moment, moment_of
from .parts import RED

_TINT = 0.72  # how red what is at fault becomes


class BridgeStage(ABC):
    """Takes pictures of one process; close it when done."""

    def __init__(self, process: Process) -> None:
        self._process = process

    def picture(self, tick: int) -> UInt8[np.ndarray, "height width 3"]:
        """One picture; ticks are counted from 0, negative ones from the end."""
        return self._draw(moment_of(self._process, tick))

    @abstractmethod
    def _draw(self, moment: Moment) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of one moment."""

    @abstractmethod
    def close(self) -> None:
        """Gives back what the stage holds."""


class MujocoStage(BridgeStage):
    """A MuJoCo scene: compiled once, bodies moved and reddened from picture to picture."""

    def __init__(
        self, process: Process, width: int, height: int, camera: Camera, oversampling: int
    ) -> None:
        super().__init__(process)
        mujoco = import_mujoco()
        self._mujoco, self._camera = mujoco, camera
        text = bridge_mjcf(process.robot_goals, process.plank_goal, aspect=width / height)
        self._model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self._model)
        self._colours = self._model.geom_rgba.copy()
        robots = len(process.robot_goals)
        self._bodies = [PLANK, *(robot_name(i) for i in range(robots))]
        self._mocap = [self._model.body(name).mocapid[0] for name in self._bodies]
        self._geoms = [self._opaque(name) for name in self._bodies]
        self._offscreen = Offscreen(self._model, width, height, oversampling)

    def place(self, moment: Moment) -> None:
        """Moves and colours the bodies."""
        x, y, theta = moment.plank
        self.data.mocap_pos[self._mocap[0]] = x, y, 0.0
        self.data.mocap_quat[self._mocap[0]] = math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)
        self.data.mocap_pos[self._mocap[1:]] = moment.robots
        for geoms, red in zip(self._geoms, [moment.red_plank, *moment.red_robots], strict=True):
            plain = self._colours[geoms, :3]
            shown = plain + _TINT * (np.array(RED) - plain) if red else plain
            self._model.geom_rgba[geoms, :3] = shown
        self._mujoco.mj_kinematics(self._model, self.data)
        self._mujoco.mj_camlight(self._model, self.data)

    def _draw(self, moment: Moment) -> UInt8[np.ndarray, "height width 3"]:
        self.place(moment)
        return self._offscreen.picture(self.data, self._camera)

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._offscreen.close()

    def _opaque(self, name: str) -> Int[np.ndarray, " geoms"]:
        """A body's geoms without its shadow."""
        owned = self._model.geom_bodyid == self._model.body(name).id
        return np.flatnonzero(owned & (self._model.geom_rgba[:, 3] == 1.0))


class TopviewStage(BridgeStage):
    """A top view drawn by matplotlib, for machines without OpenGL."""

    def __init__(self, process: Process, width: int, height: int) -> None:
        super().__init__(process)
        self._size = width, height

    def _draw(self, moment: Moment) -> UInt8[np.ndarray, "height width 3"]:
        from .topview import topview_image  # brings matplotlib, which MuJoCo's pictures do without

        process = self._process
        return topview_image(moment, process.robot_goals, process.plank_goal, *self._size)

    def close(self) -> None:
        """Nothing is held."""


def open_stage(
    process: Process,
    *,
    width: int,
    height: int,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
    oversampling: int = 2,
) -> BridgeStage:
    """A stage for one process.

    Args:
        process: The process.
        width: Of the pictures, pixels.
        height: Of the pictures, pixels.
        camera: MuJoCo's camera; the drawn view is always from the top.
        renderer: "auto" draws a top view where OpenGL cannot be used, and says so once on stderr.
        oversampling: MuJoCo renders so many times wider and higher, and averages.

    Raises:
        ValueError: If the process has no ticks, or its parts do not fit together.
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    _check(process)
    if mujoco_draws(renderer):
        return MujocoStage(process, width, height, camera, oversampling)
    return TopviewStage(process, width, height)


def _check(process: Process) -> None:
    ticks, robots = len(process.stage), len(process.robot_goals)
    if ticks == 0:
        raise ValueError("`process` must have at least one tick to be drawn; got none.")
    if process.plank.shape != (ticks, 3) or process.robots.shape != (ticks, robots, 2):
        raise ValueError(
            f"`process` must hold {ticks} plank poses and {ticks} places of {robots} robots, one "
            f"per tick and goal; got shapes {process.plank.shape} and {process.robots.shape}."
        )
