"""Where pictures are taken: a MuJoCo model whose bodies are moved, or a drawn top view.

A task says what a state of its scene is, for example poses and a verdict, how a MuJoCo model is moved
into a state (`MovableModel`), and how a state is drawn from above.
"""

import os
import sys
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from PIL import Image

from .mjcf import yaw_quaternion
from .picture import Picture

Camera = Literal["studio", "top"]
RendererName = Literal["auto", "mujoco", "matplotlib"]
State = TypeVar("State")

OVERSAMPLING = 3  # of pictures for print; a video makes do with less
VIDEO_OVERSAMPLING = 2


class Shot(NamedTuple):
    """How pictures are taken.

    Attributes:
        width: Of the pictures, pixels.
        height: Of the pictures, pixels.
        camera: MuJoCo's camera; the drawn view is always from the top.
        renderer: "auto" draws a top view where OpenGL cannot be used, and says so once on stderr.
        oversampling: MuJoCo renders so many times wider and higher, and averages.
    """

    width: int
    height: int
    camera: Camera
    renderer: RendererName
    oversampling: int = OVERSAMPLING


class Stage(ABC, Generic[State]):
    """Takes pictures of a scene in any of its states; close it when done."""

    @abstractmethod
    def picture(self, state: State) -> Picture:
        """The picture of one state."""

    @abstractmethod
    def close(self) -> None:
        """Gives back what the stage holds."""


class MovableModel(ABC, Generic[State]):
    """A MuJoCo model, compiled once, whose mocap bodies are moved and recoloured.

    Attributes:
        model: MuJoCo's model.
        data: MuJoCo's data.
    """

    def __init__(self, text: str) -> None:
        mujoco = import_mujoco()
        self.model: Any = mujoco.MjModel.from_xml_string(text)
        self.data: Any = mujoco.MjData(self.model)

    @abstractmethod
    def place(self, state: State) -> None:
        """Moves and colours the bodies."""

    def move(self, body: str, x: float, y: float, z: float = 0.0, theta: float = 0.0) -> None:
        """Moves a mocap body by its name, m and rad."""
        mocap = self.model.body(body).mocapid[0]
        self.data.mocap_pos[mocap] = x, y, z
        self.data.mocap_quat[mocap] = yaw_quaternion(theta)


class MujocoStage(Stage[State]):
    """Takes pictures of a MuJoCo model through OpenGL.

    Edges are smoothed by averaging a larger picture: without a GPU this takes a good deal less time
    than OpenGL's own multisampling.
    """

    def __init__(self, scene: MovableModel[State], shot: Shot) -> None:
        self._scene, self._camera, self._oversampling = scene, shot.camera, shot.oversampling
        self._mujoco = mujoco = import_mujoco()
        model = scene.model
        fine = shot.oversampling * shot.width, shot.oversampling * shot.height
        model.vis.global_.offwidth, model.vis.global_.offheight = fine
        model.vis.quality.offsamples = 0
        self._renderer = mujoco.Renderer(model, fine[1], fine[0])
        # Shadows and reflections would cost more time than all the rest.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._renderer.scene.flags[flag] = False

    def picture(self, state: State) -> Picture:
        """What the camera sees of one state."""
        scene = self._scene
        scene.place(state)
        self._mujoco.mj_kinematics(scene.model, scene.data)
        self._mujoco.mj_camlight(scene.model, scene.data)
        self._renderer.update_scene(scene.data, camera=self._camera)
        return np.array(Image.fromarray(self._renderer.render()).reduce(self._oversampling))

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._renderer.close()


class TopviewStage(Stage[State]):
    """A top view drawn by matplotlib, for machines without OpenGL."""

    def __init__(self, draw: Callable[[State, int, int], Picture], width: int, height: int) -> None:
        self._draw, self._size = draw, (width, height)

    def picture(self, state: State) -> Picture:
        """One state from above."""
        return self._draw(state, *self._size)

    def close(self) -> None:
        """Nothing is held."""


def open_stage(
    model: Callable[[], MovableModel[State]],
    topview: Callable[[State, int, int], Picture],
    shot: Shot,
) -> Stage[State]:
    """A stage for one scene.

    Args:
        model: Compiles the scene for MuJoCo; called where MuJoCo takes the pictures.
        topview: Draws a state from above, in so many pixels wide and high.
        shot: How the pictures are taken.

    Raises:
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    if _mujoco_draws(shot.renderer):
        return MujocoStage(model(), shot)
    return TopviewStage(topview, shot.width, shot.height)


def _mujoco_draws(renderer: RendererName) -> bool:
    """Whether MuJoCo takes the pictures; if "auto" comes to a top view, stderr says so once.

    Raises:
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    if renderer == "matplotlib":
        return False
    problem = gl_problem()
    if problem is None:
        return True
    if renderer == "mujoco":
        raise RuntimeError(f"MuJoCo cannot render here: {problem}.")
    _announce(problem)
    return False


@cache
def gl_problem() -> str | None:
    """Why MuJoCo cannot render in this process, in one line; None if it can."""
    backend = os.environ.get("MUJOCO_GL", "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW warns on stderr before MuJoCo raises
        # Libraries, drivers and displays fail in many ways, from ImportError to mujoco.FatalError.
        try:
            mujoco = import_mujoco()
            mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
        except Exception as error:
            # First line only: some of these messages run over a page.
            text = " ".join(str(error).splitlines()[:1]) or type(error).__name__
            problem = f"MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}: {text}"
            os.environ["MUJOCO_GL"] = backend  # with a choice that fails, MuJoCo cannot be imported
            return problem
    return None


@cache
def _announce(problem: str) -> None:
    print(f"deggflow: no 3D pictures, drawing a top view instead ({problem})", file=sys.stderr)


def import_mujoco() -> Any:
    """MuJoCo; it reads MUJOCO_GL when it is imported, so the choice is made here."""
    headless = not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if sys.platform.startswith("linux") and headless and not os.environ.get("MUJOCO_GL"):
        os.environ["MUJOCO_GL"] = "egl"
    import mujoco

    return mujoco


def import_physics() -> Any:
    """MuJoCo for its dynamics alone, on machines without OpenGL, too."""
    if gl_problem() is None:
        return import_mujoco()
    chosen = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        import mujoco
    finally:
        os.environ["MUJOCO_GL"] = chosen
    return mujoco
