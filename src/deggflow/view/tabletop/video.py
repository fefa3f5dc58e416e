"""A short video of a generation: objects move to their places, regions turn green on the way."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw

from deggflow.files import StrPath
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import judge
from deggflow.view.picture import INK, Picture, Sheet, font
from deggflow.view.stage import VIDEO_OVERSAMPLING, Camera, RendererName, Shot, Stage
from deggflow.view.video import BAR, counted, even, frame, write_frames

from .marks import checked_poses
from .stage import Arrangement, tabletop_stage

Frames = Sequence[Float[np.ndarray, "agents 3"]]


def write_video(
    path: StrPath,
    condition: SceneCondition,
    frames_poses: Frames,
    *,
    left_poses: Frames | None = None,
    titles: tuple[str, str] = ("Nominal", "Guided"),
    taus: Sequence[float] | None = None,
    fps: int = 25,
    width: int = 640,
    height: int = 480,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Writes a generation as MP4 (H.264, yuv420p); a kill leaves the old file or the new one.

    Args:
        path: The file, ending in ".mp4".
        condition: Objects, requirements and table.
        frames_poses: One array of poses (m, m, rad) per frame.
        left_poses: A second generation of as many frames, shown on the left.
        titles: Of the two generations, left and right.
        taus: Generation time of each frame; evenly from 0 to 1 if not given.
        fps: Frames per second.
        width: Of one generation's picture, pixels.
        height: Of one generation's picture, pixels.
        camera: "studio" (slanted) or "top"; MuJoCo only.
        renderer: As in `deggflow.view.tabletop.render`.
        on_frame: Told how many frames are drawn, and of how many, after each.

    Raises:
        ValueError: If there is no frame, or the sequences differ in length.
    """
    times = _checked_times(frames_poses, left_poses, taus)
    sides = [frames_poses] if left_poses is None else [left_poses, frames_poses]
    shot = Shot(width, height, camera, renderer, VIDEO_OVERSAMPLING)
    stage = tabletop_stage(condition, shot)
    with closing(stage):
        columns = [_pictures(stage, condition, side) for side in sides]
        frames = (
            _finished(list(pictures), tau, titles)
            for *pictures, tau in zip(*columns, times, strict=True)
        )
        write_frames(path, counted(frames, len(times), on_frame), fps)


def _checked_times(
    frames: Frames, left: Frames | None, taus: Sequence[float] | None
) -> Sequence[float]:
    if len(frames) == 0:
        raise ValueError("`frames_poses` must have at least one frame; got none.")
    for name, other in (("left_poses", left), ("taus", taus)):
        if other is not None and len(other) != len(frames):
            raise ValueError(
                f"`{name}` must be as long as `frames_poses` ({len(frames)} frames); "
                f"got {len(other)}."
            )
    return [float(tau) for tau in np.linspace(0.0, 1.0, len(frames))] if taus is None else taus


def _pictures(
    stage: Stage[Arrangement], condition: SceneCondition, frames: Frames
) -> Iterator[Picture]:
    rows = [checked_poses(condition, poses) for poses in frames]
    for poses, verdict in zip(rows, judge([condition] * len(rows), rows), strict=True):
        yield stage.picture(Arrangement(poses, verdict))


def _finished(pictures: Sequence[Picture], tau: float, titles: tuple[str, str]) -> Sheet:
    """One frame of even size: the pictures, and below them the generation time."""
    image = frame(pictures, titles)
    rows, columns = image.shape[:2]
    height = max(rows // 16, 16)
    bar = Image.new("RGB", (columns, height), "white")
    draw, text = ImageDraw.Draw(bar), font("regular", round(0.62 * height))
    middle, start, end = height / 2, round(3.6 * height), columns - height
    label = f"\N{GREEK SMALL LETTER TAU} = {tau:.2f}"
    draw.text((middle, middle), label, INK, text, anchor="lm")
    draw.line((start, middle, end, middle), (210, 210, 210), 3)
    draw.line((start, middle, start + tau * (end - start), middle), BAR, 5)
    return even(np.concatenate([image, bar]))
