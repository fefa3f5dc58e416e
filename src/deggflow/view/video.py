"""A short video of a generation: objects move to their places, regions turn green on the way."""

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from itertools import chain
from typing import IO, cast

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from deggflow.files import StrPath, replacing
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import judge

from .marks import checked_poses
from .picture import font, panels
from .stage import Camera, RendererName, Stage, open_stage

_HOLD = 1.0  # s, the last frame stays

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
        renderer: As in `deggflow.view.picture.render`.

    Raises:
        ValueError: If there is no frame, or the sequences differ in length.
    """
    times = _checked_times(frames_poses, left_poses, taus)
    sides = [frames_poses] if left_poses is None else [left_poses, frames_poses]
    stage = open_stage(condition, width=width, height=height, camera=camera, renderer=renderer)
    with closing(stage):
        columns = [_pictures(stage, condition, side) for side in sides]
        frames = (
            _finished(list(pictures), tau, titles)
            for *pictures, tau in zip(*columns, times, strict=True)
        )
        encode(path, frames, fps)


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
    stage: Stage, condition: SceneCondition, frames: Frames
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    rows = [checked_poses(condition, poses) for poses in frames]
    for poses, verdict in zip(rows, judge([condition] * len(rows), rows), strict=True):
        yield stage.picture(poses, verdict)


def _finished(
    pictures: list[UInt8[np.ndarray, "height width 3"]], tau: float, titles: tuple[str, str]
) -> UInt8[np.ndarray, "rows columns 3"]:
    """One frame of even size: the pictures with the generation time written into the lower edge."""
    image = panels(pictures, titles=titles) if len(pictures) > 1 else pictures[0]
    rows, columns = image.shape[:2]
    bar = max(rows // 16, 16)
    sheet = Image.new("RGB", (columns + columns % 2, rows + bar + (rows + bar) % 2), "white")
    sheet.paste(Image.fromarray(image), (0, 0))
    draw, text = ImageDraw.Draw(sheet), font("regular", round(0.62 * bar))
    middle, start, end = rows + bar / 2, round(3.6 * bar), columns - bar
    label = f"\N{GREEK SMALL LETTER TAU} = {tau:.2f}"
    draw.text((bar / 2, middle), label, (25, 25, 25), text, anchor="lm")
    draw.line((start, middle, end, middle), (210, 210, 210), 3)
    draw.line((start, middle, start + tau * (end - start), middle), (61, 111, 168), 5)
    return np.array(sheet)


def encode(path: StrPath, frames: Iterator[UInt8[np.ndarray, "rows columns 3"]], fps: int) -> None:
    """Writes frames of one even size as MP4, the last one held for a second; atomically."""
    with replacing(path) as beside:
        _run_encoder(str(beside), frames, fps)


def _run_encoder(
    name: str, frames: Iterator[UInt8[np.ndarray, "rows columns 3"]], fps: int
) -> None:
    """Feeds the frames to imageio's ffmpeg, the last one repeated.

    imageio's own writer forks the interpreter, against which JAX warns.
    """
    from imageio_ffmpeg import get_ffmpeg_exe

    first = next(frames)
    rows, columns = first.shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", str(fps)]
    codec = ["-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-pix_fmt", "yuv420p"]
    command = [get_ffmpeg_exe(), "-y", "-loglevel", "error", *source, "-i", "-", *codec]
    command += ["-movflags", "+faststart", name]  # starts to play in a browser before all is loaded
    with tempfile.TemporaryFile() as complaints:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=complaints) as encoder:
            pipe, last = cast(IO[bytes], encoder.stdin), first
            with suppress(BrokenPipeError):  # an encoder that stopped has said why
                for last in chain([first], frames):
                    pipe.write(last.tobytes())
                for _ in range(round(_HOLD * fps)):
                    pipe.write(last.tobytes())
                pipe.close()
        complaints.seek(0)
        if encoder.returncode:
            text = complaints.read().decode(errors="replace").strip()
            raise RuntimeError(f"ffmpeg could not write the video: {text}")
