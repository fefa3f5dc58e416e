"""A video of the complete process, alone or nominal beside guided."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from itertools import groupby
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from deggflow.files import StrPath
from deggflow.tasks.bridge.process import TICK, Process
from deggflow.tasks.bridge.process import Stage as ProcessStage
from deggflow.view.picture import GREY, INK, Sheet, fitting, font
from deggflow.view.stage import VIDEO_OVERSAMPLING, Camera, RendererName, Shot, Stage
from deggflow.view.video import BAR, counted, even, frame, write_frames

from .moment import Moment, moment_of
from .pictures import FAULT_INK, TITLES
from .stage import bridge_stage

STAGE_LABELS: dict[ProcessStage, str] = {
    "approach": "robots drive to the plank",
    "build": "building the bridge",
    "cross": "crossing",
}
_TRACK = (214, 214, 214)


class _Side(NamedTuple):
    """One process and where its pictures are taken.

    Attributes:
        process: The process.
        stage: Open while the video is written.
    """

    process: Process
    stage: Stage[Moment]


def write_process_video(
    path: StrPath,
    process: Process,
    *,
    left: Process | None = None,
    titles: tuple[str, str] = TITLES,
    fps: int = 20,
    width: int = 960,
    height: int = 540,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Writes a process as MP4 (H.264, yuv420p); a kill leaves the old file or the new one.

    Every tick is a frame: `fps` 20 is twice real time. Below each picture a bar names the time and
    the stage; where the process failed, it says why, in red. The last frame stays for a second.

    Args:
        path: The file, ending in ".mp4".
        process: The process.
        left: The nominal process from the same start, shown on the left; whichever ends first
            holds its last frame.
        titles: Above the pictures, if there are two.
        fps: Frames per second.
        width: Of one process's picture, pixels.
        height: Of one process's picture, pixels.
        camera: As in `deggflow.view.bridge.picture`.
        renderer: As in `deggflow.view.bridge.picture`.
        on_frame: Told how many frames are drawn, and of how many, after each.
    """
    processes = [process] if left is None else [left, process]
    shot = Shot(width, height, camera, renderer, VIDEO_OVERSAMPLING)
    with ExitStack() as stages:
        sides = []
        for each in processes:
            stage = stages.enter_context(closing(bridge_stage(each, shot)))
            sides.append(_Side(each, stage))
        total = max(len(side.process.stage) for side in sides)
        write_frames(path, counted(_frames(sides, titles, total), total, on_frame), fps)


def _frames(sides: list[_Side], titles: tuple[str, str], total: int) -> Iterator[Sheet]:
    columns = [_column(side, total) for side in sides]
    for images in zip(*columns, strict=True):
        yield even(frame(images, titles))


def _column(side: _Side, total: int) -> Iterator[UInt8[np.ndarray, "rows width 3"]]:
    """A process's pictures with the bar below, the last one repeated up to `total`."""
    for tick in range(total):
        if tick < len(side.process.stage):
            picture = side.stage.picture(moment_of(side.process, tick))
            image = np.concatenate([picture, _bar(side.process, tick, total, *picture.shape[:2])])
        yield image


def _bar(
    process: Process, tick: int, total: int, height: int, width: int
) -> UInt8[np.ndarray, "rows width 3"]:
    """Time and stage, or why the process failed, above a line that fills from left to right."""
    rows = max(height // 14, 16)
    sheet = Image.new("RGB", (width, rows), "white")
    draw, size = ImageDraw.Draw(sheet), round(0.62 * rows)
    edge, middle = round(0.5 * rows), 0.40 * rows
    draw.text((edge, middle), f"{tick * TICK:.1f} s", INK, font("regular", size), "lm")
    start = edge + round(font("regular", size).getlength("000.0 s")) + edge
    failed = process.failure is not None and tick == len(process.stage) - 1
    text = str(process.failure) if failed else _label(process, tick)
    letters = fitting(text, size, width - start - edge)
    draw.text((start, middle), text, FAULT_INK if failed else GREY, letters, "lm")
    _draw_line(draw, process, tick, total, (edge, width - edge, rows))
    return np.array(sheet)


def _label(process: Process, tick: int) -> str:
    """The stage, and who was lost."""
    lost = [f"robot {robot + 1}" for robot in process.lost_by(tick)]
    label = STAGE_LABELS[process.stage[tick]]
    return f"{label} without {' and '.join(lost)}" if lost else label


def _draw_line(
    draw: ImageDraw.ImageDraw,
    process: Process,
    tick: int,
    total: int,
    place: tuple[int, int, int],
) -> None:
    """One piece a stage, all of them as long as the longer process together."""
    left, right, rows = place
    scale, y, thickness = (right - left) / total, round(0.86 * rows), max(rows // 12, 2)
    first = 0
    for _, stage in groupby(process.stage):
        after = first + len(list(stage))
        reach = min(max(tick + 1, first), after)
        for end, colour in ((after, _TRACK), (reach, BAR)):
            x0, x1 = left + scale * first, left + scale * end - 3
            if x1 > x0:
                draw.line((x0, y, x1, y), colour, thickness)
        first = after
