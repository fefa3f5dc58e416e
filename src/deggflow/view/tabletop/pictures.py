"""Pictures of scenes."""

from contextlib import closing

import numpy as np
from jaxtyping import Float, UInt8

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import judge
from deggflow.view.stage import Camera, RendererName, Shot

from .marks import checked_poses
from .stage import Arrangement, tabletop_stage


def render(
    condition: SceneCondition,
    poses: Float[np.ndarray, "agents 3"],
    *,
    width: int = 960,
    height: int = 720,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
) -> UInt8[np.ndarray, "height width 3"]:
    """A picture of one scene.

    Args:
        condition: Objects, requirements and table.
        poses: x, y (m) and theta (rad) of each object.
        width: Of the picture, pixels.
        height: Of the picture, pixels.
        camera: "studio" (slanted) or "top"; MuJoCo only.
        renderer: "mujoco", "matplotlib" (a top view), or "auto": MuJoCo where OpenGL can be used.
    """
    rows = checked_poses(condition, poses)
    stage = tabletop_stage(condition, Shot(width, height, camera, renderer))
    with closing(stage):
        return stage.picture(Arrangement(rows, judge([condition], [rows])[0]))
