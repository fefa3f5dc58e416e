"""Files of a trial, made in memory: pictures of how it ends, a model, and a video of the whole."""

import tempfile
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from deggflow.tasks.bridge.assembly import assemble, surroundings
from deggflow.tasks.bridge.process import Process
from deggflow.tasks.bridge.trial import Trial
from deggflow.view.bridge import picture, write_process_video
from deggflow.view.bridge.mjcf import bridge_mjcf
from deggflow.view.bridge.moment import moment_of
from deggflow.view.bridge.topview import topview_figure

from .exports import Export


def _process(trial: Trial) -> Process:
    """The building alone; robots' goals as of the first trial of a file."""
    return assemble(trial, surroundings(trial.condition, trial.seed, 1, drives=False))


def _svg(trial: Trial) -> Export:
    process, buffer = _process(trial), BytesIO()
    figure = topview_figure(moment_of(process, -1), process.robot_goals, process.plank_goal)
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return Export("trial.svg", "image/svg+xml", buffer.getvalue())


def _png(trial: Trial) -> Export:
    buffer = BytesIO()
    Image.fromarray(picture(_process(trial), -1)).save(buffer, format="PNG")
    return Export("trial.png", "image/png", buffer.getvalue())


def _mjcf(trial: Trial) -> Export:
    goals = surroundings(trial.condition, trial.seed, 1, drives=False).goals
    return Export(
        "trial.xml", "application/xml", bridge_mjcf(goals, np.array(trial.condition.goal)).encode()
    )


def _mp4(trial: Trial) -> Export:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.mp4"
        write_process_video(path, _process(trial), width=640, height=360)
        return Export("trial.mp4", "video/mp4", path.read_bytes())


BRIDGE_EXPORTS: Mapping[str, Callable[[Trial], Export]] = {
    "svg": _svg,
    "png": _png,
    "mjcf": _mjcf,
    "mp4": _mp4,
}
