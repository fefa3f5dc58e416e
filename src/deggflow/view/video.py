"""Frames of a video: beside each other, of even size, written as MP4."""

import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import IO, cast

import numpy as np
from jaxtyping import UInt8

from deggflow.files import StrPath, replacing

from .picture import Ink, Picture, Sheet, panels

BAR: Ink = (61, 111, 168)  # of the line that fills from left to right as time passes
_HOLD = 1.0  # s, the last frame stays


def frame(images: Sequence[Picture], titles: Sequence[str]) -> Sheet:
    """Pictures beside each other under their titles; one alone has none."""
    return panels(images, titles=titles) if len(images) > 1 else images[0]


def even(
    image: UInt8[np.ndarray, "rows columns 3"],
) -> UInt8[np.ndarray, "even_rows even_columns 3"]:
    """White added below and to the right, as H.264 needs even sides."""
    rows, columns = image.shape[:2]
    pad = ((0, rows % 2), (0, columns % 2), (0, 0))
    return np.pad(image, pad, constant_values=255)


def counted(
    frames: Iterator[Sheet], total: int, on_frame: Callable[[int, int], None] | None
) -> Iterator[Sheet]:
    """The frames; after each, `on_frame` is told how many there have been, and of how many."""
    for count, each in enumerate(frames, start=1):
        yield each
        if on_frame is not None:
            on_frame(count, total)


def write_frames(
    path: StrPath, frames: Iterator[UInt8[np.ndarray, "rows columns 3"]], fps: int
) -> None:
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
        # In a session of its own, as Ctrl-C in a terminal would end it before this process knows why.
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stderr=complaints, start_new_session=True
        ) as encoder:
            pipe, last = cast(IO[bytes], encoder.stdin), first
            try:
                for last in chain([first], frames):
                    pipe.write(last.tobytes())
                for _ in range(round(_HOLD * fps)):
                    pipe.write(last.tobytes())
                pipe.close()
            except BrokenPipeError:
                pass  # an encoder that stopped has said why
            except BaseException:
                encoder.kill()
                raise
        complaints.seek(0)
        if encoder.returncode:
            text = complaints.read().decode(errors="replace").strip()
            raise RuntimeError(f"ffmpeg could not write the video: {text}")
