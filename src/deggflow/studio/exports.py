"""Files of a scene, made in memory."""

from collections.abc import Callable, Mapping
from io import BytesIO
from typing import NamedTuple

from PIL import Image

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import Poses
from deggflow.view.tabletop import render, scene_mjcf
from deggflow.view.tabletop.topview import topview_figure


class Export(NamedTuple):
    """A file.

    Attributes:
        name: Suggested to the user.
        type: Its media type.
        content: What it holds.
    """

    name: str
    type: str
    content: bytes


def _svg(condition: SceneCondition, poses: Poses) -> Export:
    figure, buffer = topview_figure(condition, poses), BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return Export("scene.svg", "image/svg+xml", buffer.getvalue())


def _png(condition: SceneCondition, poses: Poses) -> Export:
    buffer = BytesIO()
    Image.fromarray(render(condition, poses)).save(buffer, format="PNG")
    return Export("scene.png", "image/png", buffer.getvalue())


def _mjcf(condition: SceneCondition, poses: Poses) -> Export:
    return Export("scene.xml", "application/xml", scene_mjcf(condition, poses).encode())


EXPORTS: Mapping[str, Callable[[SceneCondition, Poses], Export]] = {
    "svg": _svg,
    "png": _png,
    "mjcf": _mjcf,
}
