"""`deggflow tabletop`: data, train, generate, certify, evaluate, render."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from deggflow.jsonl import InputError

from .certifying import against, chosen_lines, conclude, read, tell
from .runs import (
    MAX_COUNT,
    MAX_SEED,
    check_output,
    digest_of_weights,
    in_range,
    printable,
    shown_training,
    training_config,
    wanted,
    write_results,
)
from .session import NOT_SATISFIED, SATISFIED, console, output, prepare_jax, progress

if TYPE_CHECKING:
    from rich.progress import Progress

    from deggflow.tasks.tabletop.condition import SceneCondition
    from deggflow.tasks.tabletop.generator import TabletopGenerator
    from deggflow.tasks.tabletop.scene import Scene

TOLERANCE = 1e-6  # m and m^2 by which a certificate's numbers may be off, as they were rounded

Family = Literal["default", "changed", "opposite", "side", "larger", "combined", "balanced"]


def data(
    out: Path,
    training: int = 4_000,
    validation: int = 400,
    clearance: float = 0.10,
    seed: int = 0,
) -> int:
    """Make training and validation scenes of 4, 5 and 6 objects.

    Args:
        out: Folder that receives training.jsonl and validation.jsonl. Rerun the command to resume an interrupted run.
        training: Training scenes of each size.
        validation: Validation scenes of each size.
        clearance: Free space aimed at around objects and regions, m.
        seed: Seed of the scenes.
    """
    in_range("training", training, 1, MAX_COUNT)
    in_range("validation", validation, 1, MAX_COUNT)
    in_range("seed", seed, 0, MAX_SEED // 2)  # training and validation use 2 seed and 2 seed + 1
    if not 0.015 <= clearance <= 0.5:
        raise InputError(f"--clearance must lie in [0.015, 0.5] m; got {clearance}")
    prepare_jax()
    from deggflow.tasks.tabletop.data import Recipe, write_data

    recipe = Recipe(training=training, validation=validation, clearance=clearance, seed=seed)
    with progress() as bars:
        bar = bars.add_task("scenes", total=None)
        write_data(out, recipe, lambda done, total: bars.update(bar, completed=done, total=total))
    console().print(f"Training and validation scenes are in {out}.")
    return SATISFIED


def train(
    data: Path,
    out: Path,
    steps: int = 50_000,
    batch: int = 256,
    learning_rate: float = 1.5e-3,
    width: int = 128,
    rounds: int = 2,
    head_width: int = 256,
    seed: int = 0,
) -> int:
    """Train a nominal field. Rerun the command to resume an interrupted run; more steps extend a finished one.

    Args:
        data: Folder with training.jsonl and validation.jsonl.
        out: Folder that receives config.json, checkpoints, curves.csv, curves.png, field.safetensors and its card field.json.
        steps: Training steps, a multiple of 500. Steps added to a finished run have a warm-up and a cosine of their own.
        batch: Scenes a step.
        learning_rate: Peak of the cosine schedule.
        width: Width of the message-passing layers.
        rounds: Rounds of messages.
        head_width: Width of the last layers.
        seed: Seed of initial weights, batches and noise.
    """
    for name, value in (("width", width), ("rounds", rounds), ("head-width", head_width)):
        in_range(name, value, 1, 10_000)
    prepare_jax()
    config = training_config(steps, batch, learning_rate, seed)
    from deggflow.tasks.tabletop.training import train_field

    from .remake import tabletop_commands

    architecture = {"width": width, "rounds": rounds, "head_width": head_width}
    with shown_training(steps, out) as show:
        train_field(data, out, config, architecture, show, commands=tabletop_commands(architecture))
    console().print(f"Weights, card and curves are in {out}.")
    return SATISFIED


def make_generator(weights: Path | None, guidance: str) -> "TabletopGenerator":
    """A generator for a weights file (the shipped one if None) and a guidance by name."""
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator
    from deggflow.tasks.tabletop.requirements import tabletop_guidance

    field = load_field(weights)
    return TabletopGenerator(field, tabletop_guidance() if guidance == "degg" else None)


def generate(
    conditions: Path | None = None,
    size: int | None = None,
    count: int | None = None,
    requirements: Family = "changed",
    seed: int = 0,
    out: Path | None = None,
    guidance: Literal["degg", "none"] = "degg",
    max_draws: int = 8,
    trace: bool = False,
    weights: Path | None = None,
) -> int:
    """Generate scenes, each with its certificate, as JSON Lines.

    Exit code 0: every scene satisfies its requirements (or --guidance none); 3: some do not, and their lines
    say why; 2: bad input.

    Args:
        conditions: File of conditions, one JSON object a line.
        size: Instead of a file: number of objects of randomly drawn scenes: 1 to 12 different ones on the paper's
            table; more are a large scene: types repeat, and the table grows in proportion.
        count: How many scenes to draw with --size (default 1).
        requirements: How the requirements of drawn scenes are changed.
        seed: Seed of drawn conditions and of z(0).
        out: File that receives the scenes, line by line; rerun the command to resume. Default: stdout.
        guidance: degg: guided; none: the nominal field alone, one draw.
        max_draws: How often a scene is drawn anew until it satisfies its requirements.
        trace: Certificates also hold every requirement's value, bound and limit at every point of the generation.
        weights: Another weights file (.safetensors, card beside it).
    """
    in_range("max-draws", max_draws, 1, 10_000)
    in_range("seed", seed, 0, MAX_SEED)
    if conditions is not None and requirements != "changed":
        raise InputError("--requirements goes with --size, not with --conditions")
    prepare_jax()
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.formats import read_conditions
    from deggflow.tasks.tabletop.large import is_large, make_scenes
    from deggflow.tasks.tabletop.library import MAX_LARGE

    asked = wanted(
        conditions,
        size,
        count,
        sizes=(1, MAX_LARGE),
        read=read_conditions,
        draw=lambda size, first, many: random_conditions(size, many, requirements, seed, first),
    )
    settings = {
        "command": "tabletop generate",
        "conditions": asked.digest,
        "size": asked.size,
        "count": asked.count,
        "requirements": requirements if conditions is None else "",
        "seed": seed,
        "guidance": guidance,
        "max_draws": max_draws,
        "trace": trace,
        "weights": digest_of_weights(weights),
    }
    limit = 1 if guidance == "none" else max_draws
    check_output(out, settings)
    generator = make_generator(weights, guidance)

    def make(conditions: "list[SceneCondition]", first: int) -> "list[Scene]":
        return make_scenes(
            generator, conditions, seed=seed, first=first, max_draws=limit, keep_trace=trace
        )

    # Large scenes gain nothing from being many, and each uses the whole machine.
    large_scenes = is_large(asked.part(0, 1)[0])

    def chunks(first: int, _: "Progress") -> "Iterator[list[Scene]]":
        return asked.chunks(make, first, 1 if large_scenes else None, ahead=not large_scenes)

    failed = write_results(
        out, settings, asked, "scenes", lambda row: not row["certificate"]["satisfied"], chunks
    )
    return _summary(asked.count, failed, guidance, out)


def _summary(count: int, failed: int, guidance: str, out: Path | None) -> int:
    where = "" if out is None else f" They are in {out}."
    noun = "scene satisfies" if count == 1 else "scenes satisfy"
    console().print(f"{count - failed} of {count} {noun} every requirement.{where}")
    return NOT_SATISFIED if failed and guidance == "degg" else SATISFIED


def evaluate(
    cases: int = 1_000,
    sizes: tuple[int, ...] = (4, 5, 6, 7, 8),
    requirements: tuple[Family, ...] = ("changed",),
    seed: int = 1,
    max_draws: int = 8,
    compare: bool = False,
    out: Path | None = None,
    failures: Path | None = None,
    weights: Path | None = None,
) -> int:
    """Measure success: nominal beside guided, every guided claim checked by an independent oracle.

    Args:
        cases: Random cases of each size.
        sizes: Numbers of objects.
        requirements: Families of changed requirements, one table row each.
        seed: Seed of cases and of z(0).
        max_draws: Limit of redraws of the last column.
        compare: Compare the allocations own, pooled and local, re-anchored or not, on first draws instead.
        out: JSON Lines file that receives the rows; rerun the command to resume.
        failures: JSON Lines file to which every guided draw that its verdict refused is added, with the reason.
        weights: Another weights file (.safetensors, card beside it).
    """
    from deggflow.tasks.tabletop.library import MAX_OBJECTS

    in_range("cases", cases, 1, MAX_COUNT)
    in_range("seed", seed, 0, MAX_SEED)
    in_range("max-draws", max_draws, 1, 10_000)
    for size in sizes:
        in_range("sizes", size, 1, MAX_OBJECTS)
    prepare_jax()
    from .evaluation import run_comparison, run_evaluation

    settings = {
        "command": "tabletop evaluate",
        "cases": cases,
        "sizes": list(sizes),
        "requirements": list(requirements),
        "seed": seed,
        "max_draws": max_draws,
        "compare": compare,
        "weights": digest_of_weights(weights),
    }
    field = make_generator(weights, "none").field
    if compare:
        return run_comparison(field, settings, out)
    return run_evaluation(field, settings, out, failures)


def certify(
    scenes: Annotated[Path, tyro.conf.Positional],
    lines: tuple[int, ...] = (),
    conditions: Path | None = None,
    quiet: bool = False,
) -> int:
    """Check the scenes of a file anew, regardless of origin: by exact geometry, by Shapely, and against themselves.

    Exit code 0: every scene satisfies its requirements; 3: some do not, or a line says what is not so; 2: bad input.

    Args:
        scenes: File of scenes, as `generate` writes it.
        lines: Which lines of the file, from 1 (default: all).
        conditions: File of the conditions that were asked for, in order: every line must be of the one of its number.
        quiet: Print the totals alone.
    """
    from deggflow.tasks.tabletop.consistency import (
        UNVERIFIED,
        contradictions,
        holds,
        other_condition,
    )
    from deggflow.tasks.tabletop.formats import parse_scene, read_conditions

    found = read(scenes, parse_scene, "tabletop scene")
    chosen = chosen_lines(lines, len(found))
    wanted = None if conditions is None else read_conditions(conditions)
    asked = against(wanted, [scene.condition for scene, _ in found], other_condition)
    satisfied = wrong = 0
    for number in chosen:
        scene, line = found[number - 1]
        verdict = scene.verdict()
        good = holds(scene, verdict)
        untrue = [*contradictions(line), *asked.of(number)]
        satisfied += good
        wrong += bool(untrue)
        if not quiet:
            said = "holds" if good else f"does NOT hold: {verdict.reason(scene.condition.objects)}"
            said += f" (least margin {verdict.min_margin:.3g} m)"
            print(f"line {number}: now it {said}{'; the line is wrong' if untrue else ''}")
            tell(number, untrue)
            print(f"the certificate says: {printable(scene.certificate.table())}\n")
    conclude(asked, UNVERIFIED, quiet=quiet)
    output().print(
        f"{satisfied} of {len(chosen)} scenes satisfy every requirement; "
        f"{wrong} lines say what is not so."
    )
    true = not wrong and asked.missing is None
    return SATISFIED if satisfied == len(chosen) and true else NOT_SATISFIED


def render(
    scenes: Annotated[Path, tyro.conf.Positional],
    out: Path = Path("pictures"),
    lines: tuple[int, ...] = (),
    nominal: bool = False,
    video: bool = False,
    mjcf: bool = False,
    renderer: Literal["auto", "mujoco", "matplotlib"] = "auto",
    weights: Path | None = None,
) -> int:
    """Draw scenes of a file: green regions are free, red ones obstructed, red outlines mark what collides.

    Args:
        scenes: File of scenes, as `generate` writes it.
        out: Folder that receives the pictures.
        lines: Which lines of the file, from 1 (default: the first 12).
        nominal: Draw the nominal scene of the same z(0) beside each.
        video: Also write a video of the generation.
        mjcf: Also write each scene as a MuJoCo model (XML).
        renderer: auto: MuJoCo where a GL library is found, else a top view by matplotlib.
        weights: Weights the scenes were generated with, for --nominal and --video.
    """
    from deggflow.tasks.tabletop.formats import read_scenes

    found = read_scenes(scenes)
    chosen = lines or tuple(range(1, min(len(found), 12) + 1))
    for line in chosen:
        in_range("lines", line, 1, len(found))
    from .pictures import regenerate, write_pictures

    prepare_jax()
    generator = make_generator(weights, "degg") if nominal or video else None
    for line in chosen:
        scene = found[line - 1]
        try:
            generations = None if generator is None else regenerate(generator, scene, line)
        except InputError as error:
            raise InputError(error.reason, file=scenes, line=line) from None
        target = out / f"scene_{line:04d}.png"
        for path in write_pictures(
            scene, target, renderer, generations, nominal=nominal, video=video, mjcf=mjcf
        ):
            print(path)
    return SATISFIED
