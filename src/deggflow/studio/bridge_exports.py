"""Files of a trial, made in memory: pictures of how it ends, and models."""

from collections.abc import Callable, Mapping
from io import BytesIO

import numpy as np
from PIL import Image

from deggflow.tasks.bridge.assembly import assemble, surroundings
from deggflow.tasks.bridge.process import Process
from deggflow.tasks.bridge.trial import Trial
from deggflow.view.bridge import picture
from deggflow.view.bridge.mjcf import bridge_mjcf
from deggflow.view.bridge.moment import moment_of
from deggflow.view.bridge.stage import BridgeModel
from deggflow.view.glb import TYPE, model_glb

from .messages import Export

ASPECT = 16 / 9  # of the model's cameras


def building(trial: Trial) -> Process:
    """The building alone; robots' goals as of the first trial of a file."""
    return assemble(trial, surroundings(trial.condition, trial.seed, 1, drives=False))


def _svg(trial: Trial) -> Export:
    from deggflow.view.bridge.topview import topview_figure  # brings matplotlib

    process, buffer = building(trial), BytesIO()
    figure = topview_figure(moment_of(process, -1), process.robot_goals, process.plank_goal)
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return Export("trial.svg", "image/svg+xml", buffer.getvalue())


def _png(trial: Trial) -> Export:
    buffer = BytesIO()
    Image.fromarray(picture(building(trial), -1)).save(buffer, format="PNG")
    return Export("trial.png", "image/png", buffer.getvalue())


def _mjcf(trial: Trial) -> Export:
    goals = surroundings(trial.condition, trial.seed, 1, drives=False).goals
    return Export(
        "trial.xml", "application/xml", bridge_mjcf(goals, np.array(trial.condition.goal)).encode()
    )


def _glb(trial: Trial) -> Export:
    process = building(trial)
    model = BridgeModel(process, ASPECT)
    model.place(moment_of(process, -1))
    return Export("trial.glb", TYPE, model_glb(model.model, model.data))


TRIAL_EXPORTS: Mapping[str, Callable[[Trial], Export]] = {
    "svg": _svg,
    "png": _png,
    "mjcf": _mjcf,
    "glb": _glb,
}
