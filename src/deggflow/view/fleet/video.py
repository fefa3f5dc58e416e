"""Videos of robots: as a plan has them move, and as they follow it in MuJoCo."""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from deggflow.files import StrPath
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.picture import INK, Picture, Sheet, fitting
from deggflow.view.stage import VIDEO_OVERSAMPLING, Camera, RendererName, Shot
from deggflow.view.video import BAR, even, write_frames

from .playback import TICK, Playback
from .stage import moment_of, playback_stage
from .topview import MovingRobots

BETWEEN = 2  # frames from a waypoint to the next
FPS = 30
PLAYED_BETWEEN = 3  # frames from a waypoint to the next of a playback


def write_plan_video(path: StrPath, plan: Plan) -> None:
    """Writes a plan as MP4, robots as discs that move along their paths; the last frame stays for a second."""
    write_frames(path, _frames(plan), FPS)


def _frames(plan: Plan) -> Iterator[UInt8[np.ndarray, "rows columns 3"]]:
    robots, steps = MovingRobots(plan), plan.paths.shape[1] - 1
    for time in np.linspace(0, steps, round(BETWEEN * steps) + 1):
        step = min(int(time), steps - 1)
        share = time - step
        places = (1 - share) * plan.paths[:, step] + share * plan.paths[:, step + 1]
        yield even(robots.picture(places))


def write_playback_video(
    path: StrPath,
    playback: Playback,
    *,
    width: int = 800,
    height: int = 640,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
) -> None:
    """Writes a playback as MP4; ten waypoints take a second, and the last frame stays for a second.

    A bar below the picture says the time, how far the robots are from the plan, and how near to each other and to
    obstacles.

    Args:
        path: The file, ending in ".mp4".
        playback: What is shown.
        width: Of the picture, pixels.
        height: Of the picture without the bar, pixels.
        camera: "studio" (slanted) or "top"; MuJoCo only.
        renderer: "auto" draws a top view where OpenGL cannot be used, and says so on stderr.

    Raises:
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """
    stage = playback_stage(playback, Shot(width, height, camera, renderer, VIDEO_OVERSAMPLING))
    with closing(stage):
        pictures = ((stage.picture(moment_of(playback, tick)), tick) for tick in _ticks(playback))
        write_frames(path, _with_bars(playback, pictures), FPS)


def _ticks(playback: Playback) -> list[int]:
    """Ticks of the frames."""
    last, every = len(playback.positions) - 1, playback.scale.seconds / PLAYED_BETWEEN / TICK
    return [round(k * every) for k in range(int(last / every) + 1)]


def _with_bars(playback: Playback, pictures: Iterator[tuple[Picture, int]]) -> Iterator[Sheet]:
    away, gaps, clear = playback.deviations(), playback.gaps(), playback.clearances()
    for picture, tick in pictures:
        apart = f"{1e3 * gaps[tick]:.0f} mm from each other, " if np.isfinite(gaps[tick]) else ""
        text = (
            f"{tick * TICK:.1f} s: {1e3 * away[tick]:.0f} mm from the plan; "
            f"{apart}{1e3 * clear[tick]:.0f} mm from obstacles and bounds"
        )
        bar = _bar(picture.shape[1], text, tick / (len(away) - 1))
        yield even(np.concatenate([picture, bar]))


def _bar(width: int, text: str, share: float) -> Picture:
    """A line of text above one that fills from left to right."""
    rows = max(width // 24, 16)
    sheet = Image.new("RGB", (width, rows), "white")
    draw, edge = ImageDraw.Draw(sheet), rows // 2
    letters = fitting(text, round(0.62 * rows), width - 2 * edge)
    draw.text((edge, 0.4 * rows), text, INK, letters, "lm")
    y, thick = round(0.86 * rows), max(rows // 12, 2)
    for end, colour in ((1.0, (214, 214, 214)), (share, BAR)):
        draw.line((edge, y, edge + end * (width - 2 * edge), y), colour, thick)
    return np.array(sheet)
