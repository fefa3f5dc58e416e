"""Pictures, videos and MuJoCo models of scenes."""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from deggflow.files import write_atomically
from deggflow.jsonl import InputError
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.scene import Scene
from deggflow.tasks.tabletop.verdict import Poses, judge
from deggflow.view.mjcf import scene_mjcf
from deggflow.view.picture import render, save_png, side_by_side
from deggflow.view.video import write_video

Renderer = Literal["auto", "mujoco", "matplotlib"]

SAME_PLACE = 0.1  # m or rad; scenes of different z(0) lie several times as far apart


class Generations(NamedTuple):
    """How a scene came about: poses at every grid point, from the same z(0)."""

    nominal: list[Poses]
    guided: list[Poses]
    taus: list[float]


def regenerate(generator: TabletopGenerator, scene: Scene, line: int) -> Generations:
    """Generates a scene again from its seed and its line in the file.

    Raises:
        InputError: The scene is not what the generator makes of that seed and line.
    """
    for number in reversed(range(scene.certificate.draws)):
        z0 = initial_noise(scene.seed, np.array([line - 1]), number)[0]
        guided = generator.path(z0, scene.condition)
        # Another batch size rounds differently, and where guidance slides along the edge of a requirement
        # rounding can grow to centimetres.
        if np.abs(guided[-1] - scene.poses).mean() < SAME_PLACE:
            guided[-1] = scene.poses
            nominal = TabletopGenerator(generator.field).path(z0, scene.condition)
            return Generations(nominal, guided, generator.grid.tolist())
    raise InputError(
        "can't be generated again from its seed and line; --nominal and --video need the file as "
        "`generate --guidance degg` wrote it, and the same --weights",
        line=line,
    )


def draw(
    scene: Scene,
    target: Path,
    renderer: Renderer,
    generations: Generations | None,
    *,
    nominal: bool,
    video: bool,
    mjcf: bool,
) -> list[Path]:
    """Writes `target` (PNG) and, beside it, what else is asked for; returns the paths."""
    out = [target]
    image = render(scene.condition, scene.poses, renderer=renderer)
    if nominal and generations is not None:
        before = generations.nominal[-1]
        left = render(scene.condition, before, renderer=renderer)
        captions = (_caption(scene, before), _caption(scene, scene.poses))
        image = side_by_side(left, image, captions=captions)
    save_png(target, image)
    if video and generations is not None:
        out.append(target.with_suffix(".mp4"))
        write_video(
            out[-1],
            scene.condition,
            generations.guided,
            left_poses=generations.nominal,
            taus=generations.taus,
            renderer=renderer,
        )
    if mjcf:
        out.append(target.with_suffix(".xml"))
        write_atomically(out[-1], scene_mjcf(scene.condition, scene.poses))
    return out


def _caption(scene: Scene, poses: Poses) -> str:
    verdict = judge([scene.condition], [poses])[0]
    reason = verdict.reason(scene.condition.objects)
    if reason is not None:
        return reason
    return f"all requirements hold, {1000 * verdict.min_margin:.1f} mm to spare"
