"""Pictures, videos and curves of trials."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import UInt8

from deggflow.jsonl import InputError
from deggflow.task import AbstractEvaluation, AbstractPictures, PictureRequest
from deggflow.tasks.bridge.assembly import Surroundings, assemble, surroundings
from deggflow.tasks.bridge.condition import BridgeCondition
from deggflow.tasks.bridge.courses import Course, guided_course
from deggflow.tasks.bridge.evaluate import SOURCES
from deggflow.tasks.bridge.field import BridgeField
from deggflow.tasks.bridge.generator import BridgeGenerator
from deggflow.tasks.bridge.options import BridgeEvaluate, BridgeRender
from deggflow.tasks.bridge.policies import few_evaluations, initial_noise
from deggflow.tasks.bridge.report import ModesEvaluation
from deggflow.tasks.bridge.task import trial_generator
from deggflow.tasks.bridge.trial import Trial
from deggflow.tasks.bridge.world import DT, EXECUTED
from deggflow.view.bounds import BoundPanel, draw_bounds
from deggflow.view.picture import GREY, panels, save_png
from deggflow.view.stage import RendererName

from .paths import PathGroup, draw_paths
from .pictures import FAULT_INK, compare, picture, snapshots
from .video import write_process_video

_COLOURS = ("#4d4d4d", "#D55E00", "#0072B2")  # of demonstrations, nominal and guided paths
SAME_PLACE = 0.02  # m or rad; other seeds lead elsewhere

Image = UInt8[np.ndarray, "rows columns 3"]


class BridgePictures(AbstractPictures[Trial]):
    """Trials, start and end of each; what failed is red."""

    def __init__(self) -> None:
        self._generators: dict[float | None, BridgeGenerator] = {}

    def write(self, request: PictureRequest[Trial]) -> Iterator[Path]:
        """`trial_<number>.png`, the process, a video and curves, whatever is asked for."""
        generator, trial, options = None, request.result, request.options
        if options.nominal or options.curves:
            field = cast(BridgeField, request.field())
            generator = self._generator(field, trial.certificate.speed_limit, options)
        yield from write_pictures(trial, request.number, options, generator, request.on_note)

    def _generator(
        self, field: BridgeField, speed_limit: float | None, options: BridgeRender
    ) -> BridgeGenerator:
        """Compiled once for each speed limit that a file's trials have."""
        if speed_limit not in self._generators:
            self._generators[speed_limit] = trial_generator(
                field, speed_limit=speed_limit, drift=few_evaluations(options)
            )
        return self._generators[speed_limit]

    def draw_evaluation(self, evaluation: AbstractEvaluation[Any], options: BridgeEvaluate) -> None:
        """The planks' paths of --modes, if --figure names a file."""
        if options.figure is not None and isinstance(evaluation, ModesEvaluation):
            groups = [
                PathGroup(source, colour, [path.poses[:, :2] for path in evaluation.paths(source)])
                for source, colour in zip(SOURCES, _COLOURS, strict=True)
            ]
            draw_paths(options.figure, groups)


def regenerate(generator: BridgeGenerator, trial: Trial, line: int) -> list[BridgeCondition]:
    """What a trial's policies were conditioned on, by generating it again from its seed and line.

    Raises:
        InputError: The trial is not what the generator makes of that seed and line.
    """
    again = generator.replay(
        trial.condition, seed=trial.seed, number=line - 1, max_draws=trial.certificate.draws
    )
    poses = again.trial.poses
    # Another batch size rounds differently; in closed loop that grows to a tenth of a millimetre.
    if poses.shape == trial.poses.shape and np.abs(poses - trial.poses).max() < SAME_PLACE:
        return again.conditions
    raise InputError(
        "can't be generated again from its seed and line; --nominal and --curves need the file as "
        "`generate --guidance degg` wrote it, and the same --weights, --evaluations and --guidance-phase"
    )


def write_pictures(
    trial: Trial,
    line: int,
    options: BridgeRender,
    generator: BridgeGenerator | None,
    on_note: Callable[[str], None],
) -> list[Path]:
    """Writes `trial_<line>.png` into a folder and, beside it, what else is asked for; returns the paths.

    Args:
        trial: The trial.
        line: Its line in the file, from 1.
        options: What is to be drawn, and the folder.
        generator: What made the trial; needed for nominal trials and curves.
        on_note: Told what is drawn otherwise than asked for.
    """
    conditions = None if generator is None else regenerate(generator, trial, line)
    around = surroundings(trial.condition, trial.seed, line, drives=options.process)
    if around.lacking is not None:
        on_note(f"Trial {line} is shown from its contact points on: {around.lacking}.")
    twin = _twin(generator, trial, line) if options.nominal and generator is not None else None
    path = options.out / f"trial_{line:04d}.png"
    paths = [path]
    save_png(path, _building(trial, twin, around._replace(drive=None), options.renderer))
    process = assemble(trial, around) if options.process or options.video else None
    if process is not None and process.lost:
        on_note(f"Trial {line} is shown without the crossing, as a robot was lost.")
    if options.process and process is not None:
        paths.append(path.with_stem(f"{path.stem}_process"))
        save_png(paths[-1], snapshots(process, renderer=options.renderer))
    if options.video and process is not None:
        paths.append(path.with_suffix(".mp4"))
        left = None if twin is None else assemble(twin, around)
        write_process_video(paths[-1], process, left=left, renderer=options.renderer)
    if options.curves and generator is not None and conditions is not None:
        paths += _draw_curves(generator, trial, line, conditions, path, on_note)
    return paths


def _twin(generator: BridgeGenerator, trial: Trial, line: int) -> Trial:
    """The nominal trial from the same start and z(0)."""
    nominal = BridgeGenerator(generator.policies.field, drift=generator.policies.drift)
    return nominal.trials([trial.condition], seed=trial.seed, first=line - 1)[0]


def _building(
    trial: Trial, twin: Trial | None, around: Surroundings, renderer: RendererName
) -> Image:
    """Start and end of building; the end beside that of the nominal trial, if there is one."""
    process = assemble(trial, around)
    if twin is not None:
        captions = _caption(twin), _caption(trial)
        return compare(assemble(twin, around), process, captions=captions, renderer=renderer)
    images = [picture(process, tick, width=960, height=540, renderer=renderer) for tick in (0, -1)]
    return panels(
        images,
        titles=("start", f"after {len(trial.twists) * DT:.1f} s"),
        captions=("", _caption(trial)),
        inks=(GREY, FAULT_INK if trial.reason else GREY),
    )


def _caption(trial: Trial) -> str:
    if trial.reason is not None:
        return trial.reason
    spare = 1000 * trial.certificate.min_margin
    lost = [
        f", robot {robot + 1} lost at {actions * DT:.1f} s"
        for robot, actions in sorted(trial.lost_robots().items())
    ]
    return f"bridge built in {len(trial.twists) * DT:.1f} s, {spare:.0f} mm to spare{''.join(lost)}"


def _titled_course(
    generator: BridgeGenerator, trial: Trial, line: int, condition: BridgeCondition, policy: int
) -> tuple[str, Course]:
    """One policy's generation, and what stands above its curves."""
    record = trial.certificate.policies[policy]
    draw_number = record.draws - 1 if record.accepted else 0
    noise = initial_noise(trial.seed, np.array([line - 1]), policy, draw_number)
    course = guided_course(generator.of_draw(draw_number + 1), noise[0], condition)
    refused = "" if record.accepted else ", refused"
    return f"policy {policy + 1}, at {policy * EXECUTED * DT:.1f} s{refused}", course


def _draw_curves(
    generator: BridgeGenerator,
    trial: Trial,
    line: int,
    conditions: list[BridgeCondition],
    path: Path,
    on_note: Callable[[str], None],
) -> list[Path]:
    """Figures of q_task and q_safe for the first policy, one in the middle, and the last."""
    last = len(conditions) - 1
    if last < 0:
        on_note(f"Trial {line} has no policies, so it has no curves.")
        return []
    numbers = sorted({0, last // 2, last})
    courses = [_titled_course(generator, trial, line, conditions[k], k) for k in numbers]
    paths = []
    for row, name, label in ((0, "task", r"$q_\mathrm{task}$"), (1, "safe", r"$q_\mathrm{safe}$")):
        bound_panels = [
            BoundPanel(title, c.tau, c.value[:, row], c.bound[:, row], c.bound[-1, row])
            for title, c in courses
        ]
        paths.append(path.with_stem(f"{path.stem}_q_{name}"))
        draw_bounds(paths[-1], bound_panels, ylabel=label)
    return paths
