"""Pictures, videos and MuJoCo models of scenes."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.files import write_atomically
from deggflow.jsonl import InputError
from deggflow.task import AbstractEvaluation, AbstractPictures, PictureRequest
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.generator import TabletopGenerator, few_evaluations, initial_noise
from deggflow.tasks.tabletop.large import is_large, large_scenes_like
from deggflow.tasks.tabletop.options import TabletopRender
from deggflow.tasks.tabletop.scene import Scene
from deggflow.tasks.tabletop.task import scene_generator
from deggflow.tasks.tabletop.verdict import Poses, judge
from deggflow.view.picture import panels, save_png
from deggflow.view.tabletop import render, scene_mjcf, write_video

Renderer = Literal["auto", "mujoco", "matplotlib"]

LARGE_PIXELS, MOST_PIXELS = (
    160,
    4000,
)  # of a large scene: to a metre, and along its longer side at most
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
        guided = _path(generator, scene, line - 1, number)
        # Another batch size rounds differently, and where guidance slides along the edge of a requirement
        # rounding can grow to centimetres.
        if np.abs(guided[-1] - scene.poses).mean() < SAME_PLACE:
            guided[-1] = scene.poses
            large = is_large(scene.condition)
            taus = (large_scenes_like(generator) if large else generator).taus
            nominal = _path(_nominal(generator), scene, line - 1, number, taus)
            return Generations(nominal, guided, taus.tolist())
    raise InputError(
        "can't be generated again from its seed and line; --nominal and --video need the file as "
        "`generate --guidance degg` wrote it, and the same --weights, --evaluations and --guidance-phase",
        line=line,
    )


def _nominal(generator: TabletopGenerator) -> TabletopGenerator:
    """The generator of the nominal scenes from the same z(0)."""
    return TabletopGenerator(generator.field, drift=generator.drift)


def _path(
    generator: TabletopGenerator,
    scene: Scene,
    number: int,
    draw: int,
    at: Float[np.ndarray, " points"] | None = None,
) -> list[Poses]:
    """Poses of one draw of a scene by its number in the run, at every grid point, or those nearest to `at`."""
    if is_large(scene.condition):
        return large_scenes_like(generator).path(scene.condition, scene.seed, number, draw)
    z0 = initial_noise(scene.seed, np.array([number]), draw)[0]
    return generator.path(z0, scene.condition, at)


class TabletopPictures(AbstractPictures[Scene]):
    """Scenes: green regions are free, red ones obstructed, red outlines mark what collides."""

    def write(self, request: PictureRequest[Scene]) -> Iterator[Path]:
        """`scene_<number>.png`, a video and a MuJoCo model, whatever is asked for."""
        generations, scene = None, request.result
        options: TabletopRender = request.options
        if options.nominal or options.video:
            generator = scene_generator(request.field(), drift=few_evaluations(options))
            generations = regenerate(generator, scene, request.number)
        yield from write_pictures(
            scene, options.out / f"scene_{request.number:04d}.png", options.renderer, generations,
            nominal=options.nominal, video=options.video, mjcf=options.mjcf,
        )  # fmt: skip

    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: Any) -> None:
        """Nothing: tables say it all."""


class View(NamedTuple):
    """How a scene is drawn."""

    renderer: Renderer
    width: int  # pixels
    height: int


def view_of(condition: SceneCondition, renderer: Renderer) -> View:
    """A large scene is drawn from above unless MuJoCo is asked for, with as many pixels as its size needs."""
    if not is_large(condition):
        return View(renderer, 960, 720)
    per_metre = min(LARGE_PIXELS, MOST_PIXELS / max(condition.width, condition.depth))
    size = (
        2 * round(per_metre * (length + 1.0) / 2) for length in (condition.width, condition.depth)
    )
    return View("matplotlib" if renderer == "auto" else renderer, *size)


def write_pictures(
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
    renderer, width, height = view_of(scene.condition, renderer)
    picture = partial(render, scene.condition, width=width, height=height, renderer=renderer)
    image = picture(scene.poses)
    if nominal and generations is not None:
        before = generations.nominal[-1]
        left = picture(before)
        captions = (_caption(scene, before), _caption(scene, scene.poses))
        image = panels([left, image], titles=("Nominal", "Guided"), captions=captions)
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
