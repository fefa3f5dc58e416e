"""Experiments of the tabletop: V against an independent evaluation, bands, and a whole one in small."""

import json
import math
from dataclasses import asdict
from functools import partial

import jax
import numpy as np
import pytest

from deggflow.app.reproduce import curves as curves_module
from deggflow.app.reproduce import deviation as deviation_module
from deggflow.app.reproduce import tabletop
from deggflow.app.reproduce.curves import TrainingCurves, bands, shipped_curves
from deggflow.app.reproduce.deviation import SceneDeviations
from deggflow.app.reproduce.deviation_section import section_of
from deggflow.app.reproduce.evolution import evolution, first_pair, in_words
from deggflow.app.reproduce.examples import LeftHanded, left_handed, pairs_apart
from deggflow.app.reproduce.experiment import UNMET, Settings
from deggflow.app.reproduce.retrain import plan
from deggflow.app.reproduce.words import from_log, listed, proportion, scientific
from deggflow.deviation import Bounds, Deviation
from deggflow.jsonl import InputError
from deggflow.statistics import Rate
from deggflow.tasks.tabletop import evaluate as evaluation
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.deviation import SceneDeviation, TheoremDeviation
from deggflow.tasks.tabletop.field import build_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, default_drift, initial_noise
from deggflow.tasks.tabletop.recorded import recorded_violation
from deggflow.tasks.tabletop.requirements import tabletop_guidance
from deggflow.tasks.tabletop.verdict import BUFFER, Breach, Kind, judge
from deggflow.train import Curve
from deggflow.weights import load_card

STEPS = 12  # few, as other tests have them: programs are compiled once


@pytest.fixture(scope="module")
def field():
    """An untrained field, small so that programs are compiled soon."""
    return build_field(jax.random.key(0), width=16, rounds=1, head_width=16)


@pytest.fixture(scope="module")
def generators(field):
    drift = default_drift(STEPS, "during")
    guided = TabletopGenerator(field, tabletop_guidance(), steps=STEPS, drift=drift, guard=None)
    return TabletopGenerator(field, steps=STEPS), guided


def test_v_along_both_paths_is_what_exact_geometry_says(generators):
    condition = random_conditions(7, 1, "changed", 3)[0]
    noise = initial_noise(3, np.arange(1), 0)[0]
    found = [evolution(generator, noise, condition) for generator in generators]
    for each in found:
        assert len(each.tau) == len(each.violation) == len(each.poses) == STEPS + 1
        exact = [recorded_violation(condition, poses) for poses in each.poses]
        np.testing.assert_allclose(each.violation, exact, rtol=2e-3, atol=1e-9)
    nominal, guided = found
    assert nominal.violation[0] == pytest.approx(guided.violation[0], rel=1e-6)
    assert nominal.bound is None
    assert guided.bound[0] == pytest.approx(guided.violation[0], rel=1e-5)
    assert guided.bound[-1] == 0
    assert "bound" not in nominal.to_json()
    json.dumps(guided.to_json(), allow_nan=False)


def test_the_first_case_that_shows_what_is_wanted_is_taken(generators):
    said, asked = [], []

    def fits(condition, poses):
        asked.append(condition)
        broken = not judge([condition], [poses])[0].satisfied
        return condition if broken and len(asked) > 2 else None

    pair = first_pair(*generators, 7, 5, fits, said.append)
    assert pair.tried == pair.case.number + 1
    assert pair.case.condition == random_conditions(7, 1, "default", 5, pair.case.number)[0]
    assert judge([pair.case.condition], [pair.guided.poses[-1]])[0].satisfied
    assert said
    np.testing.assert_array_equal(
        pair.case.z0, initial_noise(5, np.array([pair.case.number]), 0)[0]
    )


def test_a_left_handed_laptop_is_the_same_but_for_its_region():
    condition = SceneCondition(("laptop", "pen_cup"))
    other = left_handed(condition)
    assert (other.objects, set(other.requirements)) == (condition.objects, {"laptop"})
    # The pen cup stands in the left-handed user's region: 0.155 m to the left, 0.07 + 0.034 m around it.
    poses = [np.array([[0.0, 0.0, 0.0], [-0.20, 0.0, np.pi]])]
    assert judge([condition], poses)[0].satisfied
    (breach,) = judge([other], poses)[0].breaches
    assert (breach.kind, breach.owner, breach.other) == (Kind.UNOBSTRUCTED, 0, 1)
    assert breach.margin == pytest.approx(0.045 - 0.07 - 0.034)
    assert in_words(breach, other) == "pen cup obstructs affordance region 1 of laptop"


def test_pairs_are_counted_once_whoever_owns_what_is_broken():
    def breach(owner, other, margin=-0.01):
        return Breach(Kind.UNOBSTRUCTED, owner, 0, other, margin)

    assert len(pairs_apart((breach(1, 2), breach(2, 1), breach(1, 3), breach(0, 4, -0.001)))) == 2


def test_bands_are_mean_and_sample_deviation_at_the_steps_that_all_seeds_have():
    rng = np.random.default_rng(0)
    losses = rng.random((3, 5, 2))
    runs = [
        [Curve(500 * (k + 1), *map(float, row)) for k, row in enumerate(run[: 5 - seed])]
        for seed, run in enumerate(losses)
    ]
    for which, band in enumerate(bands(runs)):
        np.testing.assert_array_equal(band.steps, [500, 1000, 1500])
        np.testing.assert_allclose(band.mean, np.mean(losses[:, :3, which], axis=0))
        np.testing.assert_allclose(band.deviation, np.std(losses[:, :3, which], axis=0, ddof=1))
    assert bands(runs[:1])[0].deviation is None


def curves_file(path, count=4, offset=0.0):
    rows = [f"{500 * (k + 1)},{3 + offset + 1 / (k + 1)!r},{3 + offset!r}" for k in range(count)]
    path.write_text("step,training,validation\n" + "\n".join(rows) + "\n")
    return path


def test_curves_of_as_many_seeds_as_are_there_are_shown(tmp_path, monkeypatch):
    folder = tmp_path / "tabletop/weights"
    folder.mkdir(parents=True)
    monkeypatch.setattr(curves_module, "files", lambda package: tmp_path)
    curves_file(folder / "curves.csv")
    assert list(shipped_curves()["tabletop"]) == [0]
    curves_file(folder / "curves_seed2.csv", 3, offset=1.0)
    (folder / "curves_seedling.csv").touch()
    found = shipped_curves()["tabletop"]
    assert list(found) == [0, 2]
    one = {0: found[0]}
    experiment = TrainingCurves({"bridge": one, "tabletop": found})
    result = json.loads(json.dumps(experiment.measure(Settings(), lambda text: None)))
    section = experiment.present(result, Settings())
    assert "Task 1, bridge: one seed; Task 2, tabletop: mean" in section.plots[0].caption
    assert "over 2 seeds" in section.plots[0].caption
    rows = {tuple(row[:2]): row[2:] for row in section.tables[0].rows}
    assert rows["Task 2, tabletop", "2"] == [1500, 4 + 1 / 3, 4.0]
    assert rows["Task 2, tabletop", "mean"][2] == 3.5
    assert rows["Task 2, tabletop", "standard deviation"][2] == pytest.approx(
        np.std([3, 4], ddof=1)
    )
    assert [name for name in rows if name[0] == "Task 1, bridge"] == [("Task 1, bridge", "0")]
    assert [line.ours for line in section.summary] == [
        "3.000 (one seed)",
        "3.500 ± 0.707 (2 seeds)",
    ]
    bands_drawn = [len(axes.collections) for axes in section.plots[0].figure.axes]
    assert bands_drawn == [0, 2]


def test_files_that_hold_no_curves_are_refused(tmp_path):
    path = tmp_path / "curves.csv"
    path.write_text("step,training\n1,2\n")
    with pytest.raises(InputError, match="not a file of training curves"):
        TrainingCurves({"bridge": {0: path}}).measure(Settings(), lambda text: None)


@pytest.mark.parametrize("task", ["bridge", "tabletop"])
def test_training_again_is_planned_as_the_card_says(task):
    from deggflow.app.reproduce.registry import weights

    card = load_card(weights(task))
    full, quick = plan(card, quick=False), plan(card, quick=True)
    assert full.config.steps == card["training"]["steps"]
    assert full.config.learning_rate == card["training"]["learning_rate"]
    assert full.recipe == card["data"]
    assert full.architecture == quick.architecture == card.get("architecture", {})
    assert quick.config.steps < 1_000
    assert quick.recipe["training"] < full.recipe["training"]


def test_a_whole_experiment_in_small(field, inside, tmp_path, monkeypatch):
    """Sizes, cases and draws are cut down; what is said adds up to what was measured."""
    monkeypatch.setattr(tabletop, "load_field", lambda: field)
    few = partial(TabletopGenerator, steps=STEPS, guard=None)
    monkeypatch.setattr(evaluation, "TabletopGenerator", few)
    monkeypatch.setattr(tabletop, "SIZES", (7, 8))
    monkeypatch.setattr(tabletop, "MAX_DRAWS", 1)
    monkeypatch.setattr(Settings, "cases", lambda self, full, quick: 3)
    chosen = ("tabletop_success", "training_curves")
    found = inside("reproduce", "--quick", "--out", "r", "--only", *chosen)
    out = tmp_path / "r"
    result = json.loads((out / "results" / "tabletop_success.json").read_text())
    assert (result["settings"]["seed"], result["settings"]["quick"]) == (1, True)
    rows = result["result"]["rows"]
    assert [(row["size"], row["cases"]) for row in rows] == [(7, 3), (8, 3)]
    # An untrained field: few nominal scenes are right, and guidance need not save all of them in so few steps.
    unmet = result["result"][UNMET]
    assert len(unmet) == sum(row["satisfied"] < row["cases"] for row in rows)
    assert found.returncode == (3 if unmet else 0)
    assert all(text in found.stderr.replace("\n", " ") for text in unmet)
    table = json.loads((out / "tables" / "tabletop_success.json").read_text())
    cells = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
    for cell, row in zip(cells, rows, strict=False):
        assert cell["nominal default"] == str(Rate(row["nominal_default"], 3))
        assert cell["guided, first draw"] == str(Rate(row["first_draw"], 3))
        assert cell["unsatisfied"] == 3 - row["satisfied"]
    assert cells[0]["nominal default, paper"] == "32%"
    assert cells[-1]["cases"] == 6
    assert {path.name for path in (out / "figures").iterdir()} == {
        f"{name}.{ending}" for name in chosen for ending in ("png", "pdf")
    }
    page = (out / "report.html").read_text()
    assert "Not measured yet" in page
    assert LeftHanded.name in page


def distances(ratio):
    """A stored deviation with a given W2 over spread."""
    found = Deviation(
        50, 2 * ratio, 2 * ratio, 1.0, 2.0, ratio, (ratio - 0.01, ratio + 0.02), 0.99, (0.98, 1.0)
    )
    return {"states": asdict(found), "poses": asdict(found)}


def deviation_result(*sizes, log_held=3.0):
    bounds = {"theorem": 2_000.0, "held": log_held, "samples": 4.0, "quotient": 2.0, "secant": 0.0}
    theorem = {"samples": 50, "w2": 0.5, "paired": 0.6, "log_bounds": bounds, "integral": 18.0}
    theorem |= {"largest": 300.0, "decoder": 1.35, "poses_w2": 0.4}
    rows = [
        {"size": size, "scenes": distances(0.02 * size), "own": distances(0.03 * size)}
        | {"many": distances(0.021 * size), "theorem": theorem}
        for size in sizes
    ]
    return {"seed": 1, "scenes": 50, "paths": 50, "rows": rows}


def test_the_deviation_stands_beside_the_papers_and_below_its_bounds():
    section = section_of(json.loads(json.dumps(deviation_result(4, 8))))
    ratios, theorem = section.tables
    rows = [dict(zip(ratios.columns, row, strict=True)) for row in ratios.rows]
    assert [row["W2/S in z, paper"] for row in rows] == ["20.6%", "34.5%"] + [None] * 4
    assert rows[0]["W2/S in z"] == "8.0% [7.0, 10.0]"
    (line, _) = (dict(zip(theorem.columns, row, strict=True)) for row in theorem.rows)
    assert line["theorem's bound"] == "3.9·10⁸⁶⁸"  # e^2000
    assert line["L_D W2"] == pytest.approx(1.35 * 0.5)
    text = " ".join(section.text)
    assert "12.0% instead of 8.4% (N = 4) and 24.0% instead of 16.8% (N = 8)" in text
    assert (
        "each Euler step actually stretched the gap of each pair, the bound is 2 times W2" in text
    )
    states, poses = section.summary
    assert states.paper == "20.6% and 34.5%; 98.3% to 99.9%"
    assert states.ours == poses.ours == "8.0% and 16.0%; 99.0% to 99.0%"
    quick = section_of(deviation_result(4))
    assert "20.6%" in quick.summary[0].paper
    assert "34.5%" not in quick.summary[0].paper


def test_a_sample_above_the_bound_that_holds_for_its_steps_is_told(monkeypatch):
    def unmet(log_held):
        """Of both sizes; the quick experiment evaluates the theorem for the first of them alone."""
        (row,) = deviation_result(4, log_held=log_held)["rows"]
        distance = SceneDeviation(*(Deviation(**row["scenes"][space]) for space in row["scenes"]))
        sides = TheoremDeviation(
            **{**row["theorem"], "log_bounds": Bounds(**row["theorem"]["log_bounds"])}
        )
        monkeypatch.setattr(deviation_module, "deviation_of_scenes", lambda *_: distance)
        monkeypatch.setattr(deviation_module, "deviation_of_theorem", lambda *_: sides)
        return SceneDeviations().measure(Settings(quick=True), lambda text: None)[UNMET]

    assert unmet(math.log(0.6) + 1e-9) == []
    assert unmet(math.log(0.59)) == ["deviation, N = 4: above the theorem's bound"]


def test_rates_and_small_numbers_are_said_as_one_says_them():
    assert (proportion(Rate(44, 50)), proportion(None)) == ("88%", None)
    assert proportion(Rate(112, 250)) == "44.8%"
    assert listed([Rate(112, 1_000), Rate(1_000, 1_000)]) == "11.2% / 100.0% of 1,000"
    assert scientific(BUFFER**2 / 2) == "2.0·10⁻⁴"
    numbers = (0.0, 0.0123, 3.0, 999.0, 1234.5, -2e-7)
    assert [scientific(x) for x in numbers] == ["0", "0.0123", "3", "999", "1.2·10³", "-2.0·10⁻⁷"]
    logs = (math.log(64.3), -200.0, 300.0)
    assert [from_log(x) for x in logs] == ["64.3", "1.4·10⁻⁸⁷", "1.9·10¹³⁰"]
