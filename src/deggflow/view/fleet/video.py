"""A video of robots that follow their plan."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import UInt8

from deggflow.files import StrPath
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.style import look
from deggflow.view.video import even, write_frames

from .topview import draw_ends, draw_paths, floor_axes, pixels, robot_patches

BETWEEN = 2  # frames from a waypoint to the next
FPS = 30


def write_plan_video(path: StrPath, plan: Plan) -> None:
    """Writes a plan as MP4, robots as discs that move along their paths; the last frame stays for a second."""
    with look():
        write_frames(path, _frames(plan), FPS)


def _frames(plan: Plan) -> Iterator[UInt8[np.ndarray, "rows columns 3"]]:
    figure, axes = floor_axes(plan.condition.floor)
    draw_paths(axes, plan.paths)
    draw_ends(axes, plan)
    discs = robot_patches(axes, plan)
    steps = plan.paths.shape[1] - 1
    for time in np.linspace(0, steps, round(BETWEEN * steps) + 1):
        step = min(int(time), steps - 1)
        share = time - step
        places = (1 - share) * plan.paths[:, step] + share * plan.paths[:, step + 1]
        for disc, place in zip(discs, places, strict=True):
            disc.set_center((float(place[0]), float(place[1])))
        yield even(pixels(figure))
