"""Where pictures are taken: a MuJoCo model whose objects are moved, or a drawn top view."""

import math
import os
import sys
import warnings
from abc import ABC, abstractmethod
from functools import cache
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import Verdict

from .marks import Marks, centre_of_mass, checked_poses, discs_of, marks_of
from .mjcf import (
    ASPECT,
    BALANCE,
    BLOCKED,
    CENTRE_OF_MASS,
    FREE,
    HIDDEN,
    OUTLINE,
    balance_names,
    outline_names,
    region_name,
    stage_mjcf,
)

Camera = Literal["studio", "top"]
RendererName = Literal["auto", "mujoco", "matplotlib"]


class Stage(ABC):
    """Takes pictures of one condition's objects in any poses; close it when done."""

    @abstractmethod
    def picture(
        self, poses: Float[np.ndarray, "agents 3"], verdict: Verdict
    ) -> UInt8[np.ndarray, "height width 3"]:
        """One picture; `poses` in m and rad, `verdict` decides what is red."""

    @abstractmethod
    def close(self) -> None:
        """Gives back what the stage holds."""


class Offscreen:
    """Takes pictures of a MuJoCo model through OpenGL; close it when done.

    Edges are smoothed by averaging a larger picture: without a GPU this takes a good deal less time
    than OpenGL's own multisampling.
    """

    def __init__(self, model: Any, width: int, height: int, oversampling: int) -> None:
        mujoco = import_mujoco()
        self._oversampling, fine = oversampling, (oversampling * width, oversampling * height)
        model.vis.global_.offwidth, model.vis.global_.offheight = fine
        model.vis.quality.offsamples = 0
        self._renderer = mujoco.Renderer(model, fine[1], fine[0])
        # Shadows and reflections would cost more time than all the rest.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._renderer.scene.flags[flag] = False

    def picture(self, data: Any, camera: str) -> UInt8[np.ndarray, "height width 3"]:
        """What a camera of the model sees; `data` is MuJoCo's, with positions up to date."""
        self._renderer.update_scene(data, camera=camera)
        return np.array(Image.fromarray(self._renderer.render()).reduce(self._oversampling))

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._renderer.close()


class MujocoStage(Stage):
    """A MuJoCo scene: compiled once, objects moved and recoloured from picture to picture."""

    def __init__(
        self, condition: SceneCondition, width: int, height: int, camera: Camera, oversampling: int
    ) -> None:
        mujoco = import_mujoco()
        self._mujoco, self._condition, self._camera = mujoco, condition, camera
        self._model = mujoco.MjModel.from_xml_string(stage_mjcf(condition))
        self._fit_cameras(width / height)
        self._data = mujoco.MjData(self._model)
        self._mocap = [self._model.body(name).mocapid[0] for name in condition.objects]
        self._regions = {
            (i, k): self._model.geom(region_name(name, k)).id
            for i, name in enumerate(condition.objects)
            for k in range(len(discs_of(condition, name)))
        }
        self._outlines = [
            [self._model.geom(part).id for part in outline_names(name)]
            for name in condition.objects
        ]
        self._balance: list[int] = []
        if condition.balance is not None:
            self._balance = [self._model.geom(name).id for name in balance_names()]
        self._offscreen = Offscreen(self._model, width, height, oversampling)

    def picture(
        self, poses: Float[np.ndarray, "agents 3"], verdict: Verdict
    ) -> UInt8[np.ndarray, "height width 3"]:
        """One picture; `poses` in m and rad, `verdict` decides what is red."""
        mujoco, rows = self._mujoco, checked_poses(self._condition, poses)
        for body, (x, y, theta) in zip(self._mocap, rows, strict=True):
            self._data.mocap_pos[body] = x, y, 0.0
            self._data.mocap_quat[body] = math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)
        if self._balance:
            pin = self._model.body(CENTRE_OF_MASS).mocapid[0]
            self._data.mocap_pos[pin] = *centre_of_mass(self._condition, rows), 0.0
        self._colour(marks_of(verdict))
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return self._offscreen.picture(self._data, self._camera)

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._offscreen.close()

    def _fit_cameras(self, aspect: float) -> None:
        """Widens the view for pictures narrower than the cameras were framed for."""
        if aspect < ASPECT:
            tangent = np.tan(np.radians(self._model.cam_fovy) / 2) * ASPECT / aspect
            self._model.cam_fovy[:] = np.degrees(2 * np.arctan(tangent))

    def _colour(self, marks: Marks) -> None:
        for region, geom in self._regions.items():
            self._model.geom_rgba[geom] = BLOCKED if region in marks.blocked else FREE
        for i, parts in enumerate(self._outlines):
            self._model.geom_rgba[parts] = OUTLINE if i in marks.outlined else HIDDEN
        if self._balance:
            self._model.geom_rgba[self._balance] = OUTLINE if marks.unbalanced else BALANCE


class TopviewStage(Stage):
    """A top view drawn by matplotlib, for machines without OpenGL."""

    def __init__(self, condition: SceneCondition, width: int, height: int) -> None:
        self._condition, self._size = condition, (width, height)

    def picture(
        self, poses: Float[np.ndarray, "agents 3"], verdict: Verdict
    ) -> UInt8[np.ndarray, "height width 3"]:
        """One picture; `poses` in m and rad, `verdict` decides what is red."""
        from .topview import topview_image  # brings matplotlib, which MuJoCo's pictures do without

        return topview_image(self._condition, poses, verdict, *self._size)

    def close(self) -> None:
        """Nothing is held."""


def open_stage(
    condition: SceneCondition,
    *,
    width: int,
    height: int,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
    oversampling: int = 2,
) -> Stage:
    """A stage for one condition.

    Args:
        condition: Objects, requirements and table.
        width: Of the pictures, pixels.
        height: Of the pictures, pixels.
        camera: MuJoCo's camera; the drawn view is always from the top.
        renderer: "auto" draws a top view where OpenGL cannot be used, and says so once on stderr.
        oversampling: MuJoCo renders so many times wider and higher, and averages.

    Raises:
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    if mujoco_draws(renderer):
        return MujocoStage(condition, width, height, camera, oversampling)
    return TopviewStage(condition, width, height)


def mujoco_draws(renderer: RendererName) -> bool:
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
    chosen = os.environ.get("MUJOCO_GL", "")
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
            os.environ["MUJOCO_GL"] = chosen  # with a choice that fails, MuJoCo cannot be imported
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
