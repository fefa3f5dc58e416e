"""Training and validation curves over seeds, from the logs shipped with the weights or from new training runs."""

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from deggflow.jsonl import InputError
from deggflow.train import Curve, read_curves
from deggflow.view.bands import SKIPPED, Band, CurvePanel, band_of, draw_bands
from deggflow.view.style import PAGE

from .experiment import DataTable, Finding, Plot, Progress, Section, Settings
from .paper import TRAINING_SEEDS

TASKS = {"bridge": "Task 1, bridge", "tabletop": "Task 2, tabletop"}
LOSSES = {
    "bridge": "L_MAC + 0.16 L_motion + 0.45 L_twist",
    "tabletop": "L_MAC",
}  # as in the cards

Sources = Mapping[str, Mapping[int, Path]]
"""For each task, the file of curves of each seed."""


def shipped_curves() -> Sources:
    """The curves beside the shipped weights: `curves.csv` of seed 0, `curves_seed<k>.csv` of seed k."""
    return {
        task: _curves_in(Path(str(files("deggflow.tasks"))) / task / "weights") for task in TASKS
    }


def _curves_in(folder: Path) -> dict[int, Path]:
    paths = {0: folder / "curves.csv"}
    for path in folder.glob("curves_seed*.csv"):
        seed = re.fullmatch(r"curves_seed(\d+)", path.stem)
        if seed is not None:
            paths[int(seed[1])] = path
    return dict(sorted(paths.items()))


class TrainingCurves:
    """fig:task1_learning and fig:task2_learning."""

    name = "training_curves"

    def __init__(self, sources: Sources) -> None:
        self._sources = sources

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Reads the curves; the training runs themselves are finished."""
        out: dict[str, Any] = {}
        for task, of_seeds in self._sources.items():
            say(f"{task}, {len(of_seeds)} seeds")
            out[task] = {
                str(seed): [list(curve) for curve in _read(path)] for seed, path in of_seeds.items()
            }
        return {"curves": out}

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """Mean and band of each task, and the final losses of each seed."""
        curves = {
            task: {int(seed): [Curve(*row) for row in rows] for seed, rows in seeds.items()}
            for task, seeds in result["curves"].items()
        }
        panels = [_panel(task, list(seeds.values())) for task, seeds in curves.items()]
        counts = {task: len(seeds) for task, seeds in curves.items()}
        table = DataTable(
            "training_curves",
            "Losses at the end of training, per agent in z. Training: mean over the steps since the last point; "
            "validation: of the averaged weights on held-out data.",
            ("task", "seed", "step", "training", "validation"),
            [row for task, seeds in curves.items() for row in _ends(task, seeds)],
        )
        plot = Plot(
            "training_curves",
            f"Training and validation losses: {_counted(counts)}. Axes are fitted to what "
            f"comes after the first {100 * SKIPPED:.0f}% of the steps.",
            draw_bands(panels, width=PAGE),
        )
        return Section(
            title="Training and validation curves",
            paper=f"fig:task1_learning and fig:task2_learning. Mean and one sample standard deviation over {TRAINING_SEEDS} "
            "independent seeds.",
            text=(
                "Seeds differ in initial weights, batches, noise and times; the data are the same. The loss of "
                f"Task 1 is {LOSSES['bridge']}, that of Task 2 {LOSSES['tabletop']}. Neither tends to zero, since a point of a path "
                "does not determine the noise that the path started from. The validation noise is drawn once for each seed, and most of "
                "the validation band comes from that draw. deggflow reproduce --retrain trains all seeds again.",
            ),
            tables=(table,),
            plots=(plot,),
            summary=tuple(
                Finding(
                    f"{TASKS[task]}: validation loss at the end",
                    f"curve of {TRAINING_SEEDS} seeds",
                    _spread([rows[-1].validation for rows in seeds.values()]),
                )
                for task, seeds in curves.items()
            ),
        )


def _read(path: Path) -> list[Curve]:
    curves = read_curves(path)
    if not curves:
        raise InputError("there are no training curves here", file=path)
    return curves


def common_steps(runs: Sequence[Sequence[Curve]]) -> list[int]:
    """The steps at which all runs have a point."""
    return sorted(set.intersection(*({curve.step for curve in run} for run in runs)))


def bands(runs: Sequence[Sequence[Curve]]) -> tuple[Band, Band]:
    """Mean and deviation of both losses at the common steps of all runs."""
    steps = common_steps(runs)
    at = [{curve.step: curve for curve in run} for run in runs]
    training = np.array([[run[step].training for step in steps] for run in at])
    validation = np.array([[run[step].validation for step in steps] for run in at])
    index = np.array(steps, np.int64)
    return band_of(index, training), band_of(index, validation)


def _panel(task: str, runs: Sequence[Sequence[Curve]]) -> CurvePanel:
    return CurvePanel(TASKS[task], *bands(runs))


def _ends(task: str, seeds: Mapping[int, Sequence[Curve]]) -> list[list[Any]]:
    rows: list[list[Any]] = [
        [TASKS[task], str(seed), run[-1].step, run[-1].training, run[-1].validation]
        for seed, run in seeds.items()
    ]
    training, validation = bands(list(seeds.values()))
    if training.deviation is not None and validation.deviation is not None:
        step = int(training.steps[-1])
        for name, at in (("mean", "mean"), ("standard deviation", "deviation")):
            ends = [float(getattr(band, at)[-1]) for band in (training, validation)]
            rows.append([TASKS[task], name, step, *ends])
    return rows


def _counted(counts: Mapping[str, int]) -> str:
    return "; ".join(
        f"{TASKS[task]}: "
        + ("one seed" if n == 1 else f"mean and one sample standard deviation over {n} seeds")
        for task, n in counts.items()
    )


def _spread(values: Sequence[float]) -> str:
    if len(values) == 1:
        return f"{values[0]:.3f} (one seed)"
    return f"{np.mean(values):.3f} ± {np.std(values, ddof=1):.3f} ({len(values)} seeds)"
