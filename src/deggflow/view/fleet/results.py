"""Files of pictures that `render` writes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deggflow.files import write_atomically
from deggflow.task import AbstractEvaluation, AbstractPictures, PictureRequest
from deggflow.tasks.fleet.options import FleetRender
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.style import save_figure

from .mjcf import Scale, fleet_mjcf
from .playback import play
from .robots import Drive
from .topview import plan_figure
from .video import write_plan_video, write_playback_video


class FleetPictures(AbstractPictures[Plan]):
    """Paths coloured by time; a robot that misses a requirement is red in videos. Playbacks by MuJoCo."""

    def write(self, request: PictureRequest[Plan]) -> Iterator[Path]:
        """`plan_<number>.png`, and a video and a MuJoCo model if they are asked for."""
        options: FleetRender = request.options
        target = options.out / f"plan_{request.number:04d}.png"
        save_figure(target, plan_figure(request.result))
        yield target
        if options.playback is not None:
            yield from _write_playback(request, options.playback, target)
        elif options.video:
            write_plan_video(target.with_suffix(".mp4"), request.result)
            yield target.with_suffix(".mp4")

    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Nothing: tables say it all."""


def _write_playback(request: PictureRequest[Plan], drive: Drive, target: Path) -> Iterator[Path]:
    """A model, a line on how closely robots follow the plan, and a video if it is asked for."""
    options: FleetRender = request.options
    scale = Scale(options.metres, options.seconds)
    playback = play(request.result, drive, scale)
    request.on_note(f"Plan {request.number}: {playback.text()}.")
    write_atomically(target.with_suffix(".xml"), fleet_mjcf(request.result, drive, scale))
    yield target.with_suffix(".xml")
    if options.video:
        write_playback_video(target.with_suffix(".mp4"), playback, renderer=options.renderer)
        yield target.with_suffix(".mp4")
