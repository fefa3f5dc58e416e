"""Files of pictures that `render` writes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deggflow.task import AbstractEvaluation, AbstractPictures, PictureRequest
from deggflow.tasks.fleet.options import FleetRender
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.style import save_figure

from .topview import plan_figure
from .video import write_plan_video


class FleetPictures(AbstractPictures[Plan]):
    """Paths coloured by time; a robot that misses a requirement is red in videos."""

    def write(self, request: PictureRequest[Plan]) -> Iterator[Path]:
        """`plan_<number>.png`, and a video if it is asked for."""
        options: FleetRender = request.options
        target = options.out / f"plan_{request.number:04d}.png"
        save_figure(target, plan_figure(request.result))
        yield target
        if options.video:
            write_plan_video(target.with_suffix(".mp4"), request.result)
            yield target.with_suffix(".mp4")

    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Nothing: tables say it all."""
