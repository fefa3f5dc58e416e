"""Files of a scene, made in memory: pictures and models."""

from collections.abc import Callable, Mapping
from io import BytesIO

from PIL import Image

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import Poses, judge
from deggflow.view.glb import TYPE, model_glb
from deggflow.view.tabletop import render, scene_mjcf
from deggflow.view.tabletop.mjcf import ASPECT
from deggflow.view.tabletop.stage import Arrangement, TabletopModel

from .messages import Export


def _svg(condition: SceneCondition, poses: Poses) -> Export:
    from deggflow.view.tabletop.topview import topview_figure  # brings matplotlib

    figure, buffer = topview_figure(condition, poses), BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return Export("scene.svg", "image/svg+xml", buffer.getvalue())


def _png(condition: SceneCondition, poses: Poses) -> Export:
    buffer = BytesIO()
    Image.fromarray(render(condition, poses)).save(buffer, format="PNG")
    return Export("scene.png", "image/png", buffer.getvalue())


def _mjcf(condition: SceneCondition, poses: Poses) -> Export:
    return Export("scene.xml", "application/xml", scene_mjcf(condition, poses).encode())


def _glb(condition: SceneCondition, poses: Poses) -> Export:
    model = TabletopModel(condition, ASPECT)
    model.place(Arrangement(poses, judge([condition], [poses])[0]))
    return Export("scene.glb", TYPE, model_glb(model.model, model.data))


SCENE_EXPORTS: Mapping[str, Callable[[SceneCondition, Poses], Export]] = {
    "svg": _svg,
    "png": _png,
    "mjcf": _mjcf,
    "glb": _glb,
}
