"""`deggflow bridge`: data, train, generate, certify, evaluate, render."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

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

    from deggflow.tasks.bridge.condition import TrialCondition
    from deggflow.tasks.bridge.field import BridgeField
    from deggflow.tasks.bridge.generator import BridgeGenerator, Round
    from deggflow.tasks.bridge.trial import Trial


def data(out: Path, training: int = 3_000, validation: int = 200, seed: int = 0) -> int:
    """Make training and validation demonstrations with 4, 5 and 6 robots.

    Args:
        out: Folder that receives training.jsonl and validation.jsonl. Rerun the command to resume an interrupted run.
        training: Training demonstrations of each size.
        validation: Validation demonstrations of each size.
        seed: Seed of the demonstrations.
    """
    in_range("training", training, 1, MAX_COUNT)
    in_range("validation", validation, 1, MAX_COUNT)
    in_range("seed", seed, 0, MAX_SEED // 2)  # training and validation use 2 seed and 2 seed + 1
    prepare_jax()
    from deggflow.tasks.bridge.data import Recipe, approaches, write_data

    recipe = Recipe(training=training, validation=validation, seed=seed)
    with progress() as bars:
        bar = bars.add_task("demonstrations", total=None)
        write_data(out, recipe, lambda done, total: bars.update(bar, completed=done, total=total))
    for way, rate in approaches(out / "training.jsonl").items():
        console().print(f"{way}: {rate} of the training demonstrations")
    console().print(f"Training and validation demonstrations are in {out}.")
    return SATISFIED


def train(
    data: Path,
    out: Path,
    steps: int = 40_000,
    batch: int = 256,
    learning_rate: float = 1e-3,
    seed: int = 0,
) -> int:
    """Train a nominal field. Rerun the command to resume an interrupted run; more steps extend a finished one.

    Args:
        data: Folder with training.jsonl and validation.jsonl.
        out: Folder that receives config.json, checkpoints, curves.csv, curves.png, field.safetensors and its card field.json.
        steps: Training steps, a multiple of 500. Steps added to a finished run have a warm-up and a cosine of their own.
        batch: Policies a step.
        learning_rate: Peak of the cosine schedule.
        seed: Seed of initial weights, batches and noise.
    """
    prepare_jax()
    config = training_config(steps, batch, learning_rate, seed)
    from deggflow.tasks.bridge.training import train_field

    from .remake import bridge_commands

    with shown_training(steps, out) as show:
        train_field(data, out, config, show, commands=bridge_commands)
    console().print(f"Weights, card and curves are in {out}.")
    return SATISFIED


def make_generator(
    field: "BridgeField", guidance: str, speed_limit: float | None = None
) -> "BridgeGenerator":
    """A generator for a field, a guidance by name and, guided, a speed limit (m/s)."""
    from deggflow.tasks.bridge.generator import BridgeGenerator
    from deggflow.tasks.bridge.requirements import bridge_guidance

    if guidance != "degg":
        return BridgeGenerator(field)
    guided = bridge_guidance(field.scales, speed_limit=speed_limit)
    return BridgeGenerator(field, guided, speed_limit=speed_limit)


def _speed(limit: float | None) -> None:
    if limit is not None and not 0.01 <= limit <= 10:
        raise InputError(f"--speed-limit must lie in [0.01, 10] m/s; got {limit}")


def _load_field(weights: Path | None) -> "BridgeField":
    from deggflow.tasks.bridge.field import load_field

    return load_field(weights)


def generate(
    conditions: Path | None = None,
    size: int | None = None,
    count: int | None = None,
    seed: int = 0,
    out: Path | None = None,
    guidance: Literal["degg", "none"] = "degg",
    max_draws: int = 8,
    speed_limit: float | None = None,
    weights: Path | None = None,
) -> int:
    """Generate trials, from the start until the bridge is built, each with its certificate, as JSON Lines.

    Exit code 0: every trial bridges the gap (or --guidance none); 3: some do not, and their lines say why;
    2: bad input.

    Args:
        conditions: File of conditions, one JSON object a line.
        size: Instead of a file: number of robots of randomly drawn trials, 2 to 8.
        count: How many trials to draw with --size (default 1).
        seed: Seed of drawn conditions and of z(0).
        out: File that receives the trials, line by line; rerun the command to resume. Default: stdout.
        guidance: degg: guided; none: the nominal field alone, every policy as it is drawn.
        max_draws: How often a policy is drawn anew until it is below its bounds; then the team stops.
        speed_limit: Largest speed of every robot's contact point, m/s: a private requirement of each robot.
        weights: Another weights file (.safetensors, card beside it).
    """
    in_range("max-draws", max_draws, 1, 10_000)
    in_range("seed", seed, 0, MAX_SEED)
    _speed(speed_limit)
    if speed_limit is not None and guidance == "none":
        raise InputError(
            "--speed-limit goes with --guidance degg; the nominal field cannot enforce a limit"
        )
    prepare_jax()
    from deggflow.tasks.bridge.formats import read_conditions
    from deggflow.tasks.bridge.scenes import random_conditions
    from deggflow.tasks.bridge.world import MAX_ROBOTS, MIN_ROBOTS

    asked = wanted(
        conditions,
        size,
        count,
        sizes=(MIN_ROBOTS, MAX_ROBOTS),
        read=read_conditions,
        draw=lambda size, first, many: random_conditions(size, many, seed, first),
    )
    settings = {
        "command": "bridge generate",
        "conditions": asked.digest,
        "size": asked.size,
        "count": asked.count,
        "seed": seed,
        "guidance": guidance,
        "max_draws": max_draws,
        "speed_limit": speed_limit,
        "weights": digest_of_weights(weights),
    }
    check_output(out, settings)
    generator = make_generator(_load_field(weights), guidance, speed_limit)

    def chunks(first: int, bars: "Progress") -> "Iterator[list[Trial]]":
        bar = bars.add_task("policies", total=None)

        def show(found: "Round") -> None:
            text = f"policy {found.policy + 1}, {len(found.trials)} trials under way"
            bars.update(bar, description=text)

        def make(conditions: "list[TrialCondition]", first: int) -> "Iterator[list[Trial]]":
            return generator.stream(
                conditions, seed=seed, first=first, max_draws=max_draws, on_round=show
            )

        return asked.streams(make, first)

    def fails(row: Mapping[str, Any]) -> bool:
        uncertified = guidance == "degg" and not row["certificate"]["satisfied"]
        return uncertified or not row["outcome"]["success"]

    failed = write_results(out, settings, asked, "trials", fails, chunks)
    where = "" if out is None else f" They are in {out}."
    noun = "trial bridges" if asked.count == 1 else "trials bridge"
    console().print(f"{asked.count - failed} of {asked.count} {noun} the gap.{where}")
    return NOT_SATISFIED if failed and guidance == "degg" else SATISFIED


def evaluate(
    trials: int = 50,
    sizes: tuple[int, ...] = (4, 5, 6, 7, 8),
    seed: int = 1,
    max_draws: int = 8,
    modes: int = 0,
    figure: Path | None = None,
    hard: int = 0,
    out: Path | None = None,
    weights: Path | None = None,
) -> int:
    """Measure success and every policy: nominal beside guided, every outcome replayed by an independent oracle.

    Args:
        trials: Random trials of each size.
        sizes: Numbers of robots.
        seed: Seed of trials and of z(0).
        max_draws: How often a policy is drawn anew.
        modes: Instead: so many trials from one symmetric start, and on which side planks pass.
        figure: With --modes: file that receives the planks' ways as a figure (.png, .pdf or .svg).
        hard: Instead: one guided policy from each of so many hard states of each size, next to a wall or the gap.
        out: JSON Lines file that receives the rows; rerun the command to resume.
        weights: Another weights file (.safetensors, card beside it).
    """
    from deggflow.tasks.bridge.world import MAX_ROBOTS, MIN_ROBOTS

    in_range("hard", hard, 0, MAX_COUNT)
    if hard and modes:
        raise InputError("--hard and --modes measure different things; give one")
    in_range("trials", trials, 1, MAX_COUNT)
    in_range("seed", seed, 0, MAX_SEED)
    in_range("max-draws", max_draws, 1, 10_000)
    in_range("modes", modes, 0, MAX_COUNT)
    for size in sizes or (0,):
        in_range("sizes", size, MIN_ROBOTS, MAX_ROBOTS)
    if figure is not None and (not modes or figure.suffix not in (".png", ".pdf", ".svg")):
        raise InputError("--figure goes with --modes, and ends in .png, .pdf or .svg")
    prepare_jax()
    from .bridge_evaluation import run_evaluation, run_hard, run_modes

    field = _load_field(weights)
    settings = {
        "command": "bridge evaluate",
        "seed": seed,
        "max_draws": max_draws,
        "weights": digest_of_weights(weights),
    }
    if hard:
        return run_hard(field, {**settings, "hard": hard, "sizes": list(sizes)}, out)
    if modes:
        return run_modes(field, {**settings, "modes": modes}, out, figure)
    return run_evaluation(field, {**settings, "trials": trials, "sizes": list(sizes)}, out)


def certify(
    trials: Annotated[Path, tyro.conf.Positional],
    lines: tuple[int, ...] = (),
    conditions: Path | None = None,
    quiet: bool = False,
) -> int:
    """Check the trials of a file anew, regardless of origin: replayed by an independent integrator and Shapely, and against themselves.

    Exit code 0: every trial bridges the gap; 3: some do not, or something a line says is wrong; 2: bad input.

    Args:
        trials: File of trials, as `generate` writes it.
        lines: Which lines of the file, from 1 (default: all).
        conditions: File of the conditions that were asked for, in order: every line must be of the one of its number.
        quiet: Print the totals alone.
    """
    from deggflow.tasks.bridge.consistency import UNVERIFIED, contradictions, other_condition
    from deggflow.tasks.bridge.formats import parse_trial, read_conditions
    from deggflow.tasks.bridge.oracle import fastest_contact, refutation

    found = read(trials, parse_trial, "bridge trial")
    chosen = chosen_lines(lines, len(found))
    wanted = None if conditions is None else read_conditions(conditions)
    asked = against(wanted, [trial.condition for trial, _ in found], other_condition)
    bridged = refuted = 0
    fastest = 0.0
    for number in chosen:
        trial, line = found[number - 1]
        wrong = refutation(line)
        untrue = [*contradictions(line), *asked.of(number)]
        bridged += trial.success and wrong is None
        refuted += wrong is not None or bool(untrue)
        fastest = max(fastest, fastest_contact(line))
        if not quiet:
            says = "agrees" if wrong is None else f"finds that {wrong}"
            print(printable(f"line {number}: the replay {says}"))
            tell(number, untrue)
            print(f"the certificate says: {printable(trial.certificate.table())}\n")
    conclude(asked, UNVERIFIED, quiet=quiet)
    output().print(
        f"{bridged} of {len(chosen)} trials bridge the gap; the replay refutes what {refuted} say; "
        f"the fastest contact point moved at {fastest:.3f} m/s."
    )
    true = not refuted and asked.missing is None
    return SATISFIED if bridged == len(chosen) and true else NOT_SATISFIED


def render(
    trials: Annotated[Path, tyro.conf.Positional],
    out: Path = Path("pictures"),
    lines: tuple[int, ...] = (),
    nominal: bool = False,
    process: bool = False,
    video: bool = False,
    curves: bool = False,
    renderer: Literal["auto", "mujoco", "matplotlib"] = "auto",
    weights: Path | None = None,
) -> int:
    """Draw trials of a file, start and end of each; what failed is red.

    Args:
        trials: File of trials, as `generate` writes it.
        out: Folder that receives the pictures.
        lines: Which lines of the file, from 1 (default: the first 12).
        nominal: Draw the end of the nominal trial from the same start and z(0) beside each.
        process: Also draw the complete process: robots drive to the plank, build the bridge, cross it.
        video: Also write a video, of the complete process with --process, beside the nominal one with --nominal.
        curves: Also draw q_task and q_safe under their bounds while an early, a middle and a late policy were generated.
        renderer: auto: MuJoCo where a GL library is found, else a top view by matplotlib.
        weights: Weights the trials were generated with, for --nominal and --curves.
    """
    prepare_jax()
    from deggflow.tasks.bridge.formats import read_trials

    found = read_trials(trials)
    chosen = lines or tuple(range(1, min(len(found), 12) + 1))
    for line in chosen:
        in_range("lines", line, 1, len(found))
    from .bridge_pictures import RenderOptions, write_pictures

    field = _load_field(weights) if nominal or curves else None
    generators: dict[float | None, BridgeGenerator] = {}
    options = RenderOptions(nominal, process, video, curves, renderer)
    for line in chosen:
        trial, generator = found[line - 1], None
        if field is not None:
            limit = trial.certificate.speed_limit
            generator = generators.setdefault(limit, make_generator(field, "degg", limit))
        try:
            for path in write_pictures(trial, line, out, options, generator):
                print(path, flush=True)
        except InputError as error:
            raise InputError(error.reason, file=trials, line=line) from None
    return SATISFIED
