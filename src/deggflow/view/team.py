"""Pictures of team tasks: each task draws its own samples on axes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deggflow.files import replacing
from deggflow.task import AbstractEvaluation, AbstractPictures, PictureRequest
from deggflow.task.team import AbstractTeamTask
from deggflow.task.team_sample import TeamSample

from .style import look, new_figure

INCHES = 4.2  # height of a picture


class TeamPictures(AbstractPictures[TeamSample]):
    """One figure for each sample."""

    def __init__(self, task: AbstractTeamTask) -> None:
        """Args: task: whose samples are drawn."""
        self._task = task

    def write(self, request: PictureRequest[TeamSample]) -> Iterator[Path]:
        """`<noun>_<number>.png`, with what the certificate says below."""
        result, certificate = request.result, request.result.certificate
        with look():
            figure, (axes,) = new_figure(INCHES, width=INCHES)
            self._task.draw(axes, result)
            axes.set_aspect("equal")
            if certificate is not None:
                text = certificate.reason or f"satisfied, least margin {certificate.min_margin:.3g}"
                axes.set_title(
                    text, color="#B00020" if certificate.reason else "#222222", wrap=True
                )
            path = request.options.out / f"{self._task.noun}_{request.number:04d}.png"
            with replacing(path) as beside:
                figure.savefig(beside, dpi=150, bbox_inches="tight")
        yield path

    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Nothing: the table says it all."""
