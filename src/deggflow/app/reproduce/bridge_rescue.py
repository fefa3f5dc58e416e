"""Seven robots whose nominal policies drive the plank out of the workspace, and whose guided ones don't."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deggflow.tasks.bridge.assembly import Surroundings, assemble
from deggflow.tasks.bridge.factors import PLANK_BUFFER
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.bridge.world import DT
from deggflow.view.bounds import BoundPanel, bounds_figure
from deggflow.view.bridge import picture
from deggflow.view.sheet import picture_row

from .bridge_search import commands, measure_rescue
from .bridge_success import KIND_TITLES
from .experiment import DataTable, Finding, Plot, Progress, Section, Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = 7  # robots, fig:task1_rescue
TOGETHER = 16  # nominal trials in one batch
KNOWN = {1: 87}  # by seed: the trial that a full run finds, where a quick run begins
_PLACES = {"guided": "State of the guided trial", "nominal": "State of the nominal trial"}


class BridgeRescue:
    """fig:task1_rescue and fig:task1_safe_sampling."""

    name = "bridge_rescue"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """The first example of the seed; a quick run begins at the known example."""
        example = KNOWN.get(settings.seed) if settings.quick else None
        first, together = (0, TOGETHER) if example is None else (example, 1)
        return measure_rescue(load_field(), SIZE, settings.seed, first, say, together=together)

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """The ends of both trials, and q_safe at the time of the nominal failure."""
        title = "Task 1: a nominal failure and its rescue"
        paper = (
            "fig:task1_rescue and fig:task1_safe_sampling. N = 7: nominal policies drive the plank out of the workspace, "
            "guided ones build the bridge from the same start and initial sample; q_safe ends below 0 in a guided "
            "generation right before the time of the nominal failure."
        )
        example = result["example"]
        if example is None:
            return Section(title, paper, (_scan_text(result), "None of them is an example."))
        place = example["places"]["guided"]
        return Section(
            title,
            paper,
            (_scan_text(result), _trial_text(example), _place_text(example)),
            (_table(example),),
            _plots(result["size"], example),
            commands(result, "--nominal --curves"),
            (
                Finding(
                    "Task 1, q_safe at tau = 1 before the nominal failure: nominal / guided",
                    "- / below 0",
                    f"{place['q_safe_nominal'][-1]:.2f} / {place['q_safe'][-1]:.2f}",
                ),
            ),
        )


def _scan_text(result: Mapping[str, Any]) -> str:
    first, failures = result["first"], result["failures"]
    begins = f" from number {first + 1} on" if first else ""
    kinds = "; ".join(f"{KIND_TITLES[kind]}: {count}" for kind, count in failures.items())
    return (
        f"Random trials with N = {result['size']} of seed {result['seed']} are searched in order{begins} for the first in "
        "which nominal policies drive the plank out of the workspace, guided ones bridge the gap, and a nominal policy from "
        "the guided trial's state at that time would also end with q_safe above 0. Trials searched: "
        f"{result['scanned']}. Nominal policies fail in {sum(failures.values())} of them ({kinds or 'none'}). Guided policies "
        f"were run in the {result['guided']} trials in which nominal ones violate safety; they bridge the gap in "
        f"{result['rescued']}."
    )


def _trial_text(example: Mapping[str, Any]) -> str:
    after = {name: len(example[name]["twists"]) * DT for name in ("nominal", "guided")}
    spare = 1000 * example["guided"]["certificate"]["min_margin"]
    return (
        f"Trial {example['number'] + 1}: with nominal policies, {example['nominal']['outcome']['reason']} after "
        f"{after['nominal']:.1f} s; guided ones bridge the gap in {after['guided']:.1f} s and stay {spare:.0f} mm from any "
        "failure."
    )


def _place_text(example: Mapping[str, Any]) -> str:
    own, other = example["places"]["guided"], example["places"]["nominal"]
    most = float(_excess(other).max())
    meanwhile = f", after exceeding its bound by up to {most:.2g}," if most > 0 else ""
    return (
        f"At {example['seconds']:.1f} s the guided trial's plank is {1000 * own['margin']:.0f} mm inside the workspace; from "
        f"there q_safe ends at {own['q_safe'][-1]:.3f} with guidance and at {own['q_safe_nominal'][-1]:.3f} without. The "
        f"nominal trial's is {1000 * other['margin']:.0f} mm inside, where the factor requires {1000 * PLANK_BUFFER:.0f} mm; "
        f"guided from there, q_safe{meanwhile} would still end at {other['q_safe'][-1]:.3f} instead of "
        f"{other['q_safe_nominal'][-1]:.3f}."
    )


def _excess(place: Mapping[str, Any]) -> np.ndarray:
    return np.array(place["q_safe"]) - np.array(place["beta_safe"])


def _table(example: Mapping[str, Any]) -> DataTable:
    rows = []
    for name, title in _PLACES.items():
        place = example["places"][name]
        rows.append(
            (
                title,
                1000 * place["margin"],
                place["q_safe"][0],
                place["q_safe_nominal"][-1],
                place["q_safe"][-1],
                place["beta_safe"][-1],
                float(_excess(place).max()),
                "yes" if place["hypotheses_hold"] else "no",
            )
        )
    return DataTable(
        "bridge_safe_sampling",
        "Both generations from each of the two states, with the same z(0).",
        (
            "state",
            "distance to workspace edge (mm)",
            "q_safe at tau = 0",
            "nominal q_safe at tau = 1",
            "guided q_safe at tau = 1",
            "beta_safe at tau = 1",
            "guided: largest q_safe - beta_safe",
            "hypotheses hold",
        ),
        rows,
    )


def _plots(size: int, example: Mapping[str, Any]) -> tuple[Plot, Plot]:
    return (
        Plot(
            "bridge_rescue",
            f"A trial of {size} robots, nominal and guided from the same start and z(0), each at its end, from above. Red: "
            "the plank out of the workspace. Outline: the goal of the plank.",
            _pictures(example),
        ),
        Plot(
            "bridge_safe_sampling",
            f"q_safe and its bound beta_safe at {example['seconds']:.1f} s, when the nominal trial generates the policy that "
            "fails: with guidance, and without it from the same state and z(0). Shaded: q_safe at most beta_safe.",
            safe_figure(example),
        ),
    )


def _pictures(example: Mapping[str, Any]) -> "Figure":
    around = Surroundings(None, np.array(example["robot_goals"]), 0, None)
    trials = [parse_trial(example[name]) for name in ("nominal", "guided")]
    images = [
        # The view from above shows which line is crossed.
        picture(assemble(trial, around), -1, width=1200, height=620, camera="top")
        for trial in trials
    ]
    captions = [
        f"{trial.reason or 'the bridge is built'} ({len(trial.twists) * DT:.1f} s)"
        for trial in trials
    ]
    return picture_row(images, ("Nominal", "Guided"), captions)


def safe_figure(example: Mapping[str, Any]) -> "Figure":
    """q_safe, guided and nominal, and beta_safe, for each of the two states."""
    panels = [
        BoundPanel(
            title,
            np.array(place["tau"]),
            np.array(place["q_safe"]),
            np.array(place["beta_safe"]),
            nominal=np.array(place["q_safe_nominal"]),
        )
        for title, place in ((title, example["places"][name]) for name, title in _PLACES.items())
    ]
    return bounds_figure(panels, name=r"$q_\mathrm{safe}$")
