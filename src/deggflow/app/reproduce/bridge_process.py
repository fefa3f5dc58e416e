"""A complete process of five guided robots, with q_task and its bound during generation."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deggflow.tasks.bridge.assembly import assemble, surroundings
from deggflow.tasks.bridge.courses import guided_course
from deggflow.tasks.bridge.field import BridgeField, load_field
from deggflow.tasks.bridge.generator import BridgeGenerator, Replay
from deggflow.tasks.bridge.policies import initial_noise
from deggflow.tasks.bridge.process import TICK, Process
from deggflow.tasks.bridge.requirements import PROGRESS, bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.trial import Trial
from deggflow.tasks.bridge.world import DT, EXECUTED
from deggflow.view.bounds import BoundPanel, bounds_figure
from deggflow.view.bridge import picture
from deggflow.view.bridge.pictures import telling_ticks
from deggflow.view.sheet import picture_column

from .bridge_search import commands
from .experiment import UNMET, DataTable, Finding, Plot, Progress, Section, Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = 5  # robots, fig:task1_rollout
WHEN = ("early", "middle", "late")
MOST = 100  # trials searched

_TITLES = ("Initial configuration", "The bridge is built", "Crossing the gap")


class BridgeProcess:
    """fig:task1_rollout and fig:task1_task_sampling."""

    name = "bridge_process"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """The first guided trial of the seed that becomes a complete process."""
        return measure_process(load_field(), SIZE, settings.seed, say)

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """Three moments of the process, three generations."""
        title = "Task 1: a complete process, and q_task under its bound"
        paper = (
            "fig:task1_rollout and fig:task1_task_sampling. N = 5 with SE guidance: initial configuration, bridge built, "
            "crossing; q_task stays below beta_task in policies generated at early, middle and late physical times."
        )
        example = result["example"]
        if example is None:
            return Section(
                title, paper, (f"None of {result['scanned']} trials became a complete process.",)
            )
        rows = example["policies"]
        most = max(float(_excess(row).max()) for row in rows)
        finding = Finding(
            "Task 1, largest q_task - beta_task in three generations", "below 0", f"{most:.2g}"
        )
        texts = _trial_text(result), _course_text(rows)
        plots, command = _plots(result["size"], example), commands(result, "--process --curves")
        return Section(title, paper, texts, (_table(rows),), plots, command, (finding,))


def measure_process(field: BridgeField, size: int, seed: int, say: Progress) -> dict[str, Any]:
    """`BridgeProcess.measure` for any number of robots."""
    generator = BridgeGenerator(field, bridge_guidance(field.scales))
    unmet = []
    for number in range(MOST):
        say(f"N = {size}, trial {number + 1}: robots drive, build, cross")
        (condition,) = random_conditions(size, 1, seed, number)
        replay = generator.replay(condition, seed=seed, number=number)
        if replay.trial.reason is not None:
            unmet.append(f"N = {size}, trial {number + 1}: {replay.trial.reason}")
        process = complete_process(replay.trial, number)
        if process is not None:
            break
    example = None if process is None else _example(generator, replay, number, process)
    return {
        "size": size,
        "seed": seed,
        "scanned": number + 1,
        "example": example,
        UNMET: unmet,
    }


def complete_process(trial: Trial, number: int) -> Process | None:
    """Driving to the plank, building and crossing; None if one of them fails.

    Args:
        trial: The trial.
        number: Its number in the run, which decides where robots start and end, as in `deggflow bridge render`.
    """
    around = surroundings(trial.condition, trial.seed, number + 1)
    if trial.reason is not None or around.lacking is not None:
        return None
    process = assemble(trial, around)
    whole = process.failure is None and len(telling_ticks(process)) == len(_TITLES)
    return process if whole else None


def _example(
    generator: BridgeGenerator, replay: Replay, number: int, process: Process
) -> dict[str, Any]:
    last, ticks = len(replay.conditions) - 1, telling_ticks(process)
    return {
        "number": number,
        "trial": replay.trial.to_json(),
        "moments": {
            "stages": [process.stage[tick] for tick in ticks],
            "seconds": [tick * TICK for tick in ticks],
            "plank": process.plank[ticks].tolist(),
            "robots": process.robots[ticks].tolist(),
            "robot_goals": process.robot_goals.tolist(),
        },
        "policies": [
            _policy(generator, replay, number, policy, when)
            for policy, when in zip((0, last // 2, last), WHEN, strict=True)
        ],
    }


def _policy(
    generator: BridgeGenerator, replay: Replay, number: int, policy: int, when: str
) -> dict[str, Any]:
    """The generation of one executed policy."""
    draws = replay.trial.certificate.policies[policy].draws
    noise = initial_noise(replay.trial.seed, np.array([number]), policy, draws - 1)[0]
    course = guided_course(generator.of_draw(draws), noise, replay.conditions[policy])
    at = {"when": when, "policy": policy + 1, "seconds": policy * EXECUTED * DT, "draws": draws}
    return {**at, **course.to_json()}


def _trial_text(result: Mapping[str, Any]) -> str:
    example = result["example"]
    trial = example["trial"]
    return (
        f"Trial {example['number'] + 1} of seed {result['seed']}: the first in which guided robots reach the plank, build the bridge "
        f"and cross it ({result['scanned']} searched). They build it in {len(trial['twists']) * DT:.1f} s with "
        f"{len(trial['certificate']['policies'])} policies."
    )


def _course_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """The behaviour of q_task under its bound."""
    most = max(float(_excess(row).max()) for row in rows)
    rising = [row["when"] for row in rows if row["q_task"][-1] > row["q_task"][0]]
    side = "above" if most > 0 else "below"
    text = (
        f"q_task comes within {abs(most):.2g} of its bound, from {side}. A policy must end at least {PROGRESS:g} below "
        "the present q_task."
    )
    if rising:
        text += (
            f" Where it rises ({', '.join(rising)}), the nominal field raises it: guidance keeps q_task below its bound and "
            "does not enforce descent."
        )
    return text


def _excess(row: Mapping[str, Any]) -> np.ndarray:
    return np.array(row["q_task"]) - np.array(row["beta_task"])


def _table(rows: Sequence[Mapping[str, Any]]) -> DataTable:
    return DataTable(
        "bridge_task_sampling",
        "The three generations, without the shift of the figure.",
        (
            "policy",
            "number",
            "time (s)",
            "q_task at tau = 0",
            "beta_task at tau = 0",
            "q_task at tau = 1",
            "beta_task at tau = 1",
            "largest q_task - beta_task",
            "hypotheses hold",
        ),
        [
            (
                row["when"],
                row["policy"],
                row["seconds"],
                row["q_task"][0],
                row["beta_task"][0],
                row["q_task"][-1],
                row["beta_task"][-1],
                float(_excess(row).max()),
                "yes" if row["hypotheses_hold"] else "no",
            )
            for row in rows
        ],
    )


def _plots(size: int, example: Mapping[str, Any]) -> tuple[Plot, Plot]:
    complete = f"A complete process of {size} robots with SE guidance. Rings: the robots' goals. Outline: the goal of the plank."
    return (
        Plot("bridge_process", complete, _pictures(example)),
        Plot(
            "bridge_task_sampling",
            "q_task and its bound beta_task while policies of this process are generated. Both are shifted by "
            "beta_task(1), for visualisation only; q_task - beta_task is unchanged. Shaded: q_task at most beta_task.",
            task_figure(example["policies"]),
        ),
    )


def _pictures(example: Mapping[str, Any]) -> "Figure":
    moments, goal = example["moments"], example["trial"]["condition"]["goal"]
    process = Process(
        np.array(moments["plank"]),
        np.array(moments["robots"]),
        tuple(moments["stages"]),
        np.array(moments["robot_goals"]),
        np.array([goal["x"], goal["y"], goal["theta"]]),
        None,
    )
    images = [picture(process, tick, width=1280, height=640) for tick in range(len(_TITLES))]
    titles = [
        f"{title} ({at:.1f} s)" for title, at in zip(_TITLES, moments["seconds"], strict=True)
    ]
    return picture_column(images, titles)


def task_figure(rows: Sequence[Mapping[str, Any]]) -> "Figure":
    """q_task and beta_task of each generation, minus beta_task(1)."""
    panels = [
        BoundPanel(
            f"{row['when'].capitalize()}: at {row['seconds']:.1f} s",
            np.array(row["tau"]),
            np.array(row["q_task"]),
            np.array(row["beta_task"]),
            row["beta_task"][-1],
        )
        for row in rows
    ]
    return bounds_figure(
        panels,
        name=r"$q_\mathrm{task}$",
        ylabel=r"$q_\mathrm{task}$, shifted by $\beta_\mathrm{task}(1)$",
    )
